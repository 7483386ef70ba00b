//! Messages of the validation layer, collected instead of printed.

use std::ffi::{CStr, c_void};
use std::sync::{Arc, Mutex};

use ash::vk;

use super::device::lock;
use super::error::{Named, Result};

pub(super) const LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Warnings and errors seen so far. Cheap to clone.
#[derive(Clone, Default)]
pub(super) struct Messages(Arc<Mutex<Vec<String>>>);

impl Messages {
    pub(super) fn all(&self) -> Vec<String> {
        lock(&self.0).clone()
    }

    /// The messenger's description. The messages must outlive the messenger, which holds a clone of them.
    pub(super) fn create_info(&self) -> vk::DebugUtilsMessengerCreateInfoEXT<'static> {
        use vk::DebugUtilsMessageSeverityFlagsEXT as Severity;
        use vk::DebugUtilsMessageTypeFlagsEXT as Type;
        vk::DebugUtilsMessengerCreateInfoEXT::default()
            .message_severity(Severity::WARNING | Severity::ERROR)
            .message_type(Type::VALIDATION | Type::PERFORMANCE)
            .pfn_user_callback(Some(collect))
            .user_data(Arc::as_ptr(&self.0).cast_mut().cast())
    }
}

unsafe extern "system" fn collect(
    _: vk::DebugUtilsMessageSeverityFlagsEXT,
    _: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    if data.is_null() || user.is_null() {
        return vk::FALSE;
    }
    // SAFETY: `user` is the mutex inside the `Arc` that the messenger's owner keeps; the layer passes valid data.
    unsafe {
        let messages = &*user.cast::<Mutex<Vec<String>>>();
        let text = (*data).message_as_c_str().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
        lock(messages).push(text);
    }
    vk::FALSE
}

/// A registered callback.
pub(super) struct Messenger {
    raw: Option<vk::DebugUtilsMessengerEXT>,
    functions: ash::ext::debug_utils::Instance,
    _messages: Messages,
}

impl Messenger {
    /// Registers the callback if `listen`; otherwise only stands for the enabled extension.
    pub(super) fn new(
        entry: &ash::Entry,
        instance: &ash::Instance,
        messages: &Messages,
        listen: bool,
    ) -> Result<Messenger> {
        let functions = ash::ext::debug_utils::Instance::new(entry, instance);
        let raw = if listen {
            // SAFETY: the extension is enabled on the instance; the user data lives as long as `_messages`.
            let raw = unsafe { functions.create_debug_utils_messenger(&messages.create_info(), None) };
            Some(raw.named("vkCreateDebugUtilsMessengerEXT")?)
        } else {
            None
        };
        Ok(Messenger { raw, functions, _messages: messages.clone() })
    }
}

impl Drop for Messenger {
    fn drop(&mut self) {
        if let Some(raw) = self.raw {
            // SAFETY: created from this instance, which its owner destroys later.
            unsafe { self.functions.destroy_debug_utils_messenger(raw, None) };
        }
    }
}
