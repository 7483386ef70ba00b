//! Messages of the validation layer, collected instead of printed.

use std::ffi::{CStr, c_void};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use ash::vk;

use super::error::{Error, Named, Result};
use super::lock::lock;

pub(super) const LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Setting of newer layers that makes synchronization validation follow shader accesses.
pub(super) const FOLLOW_SHADERS: &CStr = c"syncval_shader_accesses_heuristic";

/// Whether the layer accepts settings at instance creation; older layers do not.
pub(super) fn takes_settings(entry: &ash::Entry) -> Result<bool> {
    // SAFETY: a global command.
    let extensions = unsafe { entry.enumerate_instance_extension_properties(Some(LAYER)) }
        .named("vkEnumerateInstanceExtensionProperties")?;
    Ok(extensions.iter().any(|e| e.extension_name_as_c_str() == Ok(ash::ext::layer_settings::NAME)))
}

/// A boolean setting of the layer.
pub(super) fn switch<'a>(name: &'a CStr, value: &'a vk::Bool32) -> vk::LayerSettingEXT<'a> {
    vk::LayerSettingEXT {
        value_count: 1,
        p_values: std::ptr::from_ref(value).cast(),
        ..vk::LayerSettingEXT::default().layer_name(LAYER).setting_name(name).ty(vk::LayerSettingTypeEXT::BOOL32)
    }
}

/// Prefixes of the identifiers of messages about the layer itself: settings that the layer has adjusted to the device,
/// and shaders slowed by the layer's own checks.
const OF_ITSELF: [&str; 2] = ["WARNING-Setting", "GPUAV-Compile-time"];

#[derive(Default)]
struct MessageStore {
    texts: Mutex<Vec<String>>,
    closed: AtomicBool,
}

/// Warnings and errors of the validation layer. Cheap to clone. Outlives the device, because the layer reports leaked
/// objects when the device is closed.
#[derive(Clone, Default)]
pub struct Messages(Arc<MessageStore>);

impl std::fmt::Debug for Messages {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Messages").field("texts", &self.all()).field("closed", &self.is_closed()).finish()
    }
}

impl Messages {
    /// All messages so far.
    pub fn all(&self) -> Vec<String> {
        lock(&self.0.texts).clone()
    }

    /// Whether the device and all its objects are destroyed. Until then more messages may come.
    pub fn is_closed(&self) -> bool {
        self.0.closed.load(Ordering::Acquire)
    }

    pub(super) fn add(&self, text: String) {
        lock(&self.0.texts).push(text);
    }

    pub(super) fn close(&self) {
        self.0.closed.store(true, Ordering::Release);
    }

    /// Description of a messenger. These messages must outlive the messenger, so a [`Messenger`] holds a clone.
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
    // SAFETY: `user` points into the `Arc` that the messenger's owner keeps; the layer passes valid data.
    let (seen, data) = unsafe { (&*user.cast::<MessageStore>(), &*data) };
    // SAFETY: the layer passes valid text or a null pointer.
    let [id, text] = unsafe { [data.message_id_name_as_c_str(), data.message_as_c_str()] }
        .map(|s| s.map_or_else(String::new, |s| s.to_string_lossy().into_owned()));
    if !OF_ITSELF.iter().any(|of| id.starts_with(of)) {
        lock(&seen.texts).push(text);
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
    /// Registers the callback if `listen`; otherwise only represents the enabled extension.
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
            // SAFETY: created from this instance, which the owner destroys later.
            unsafe { self.functions.destroy_debug_utils_messenger(raw, None) };
        }
    }
}

/// Version of the installed validation layer, that is, of its Vulkan headers; `None` when the layer is not installed.
pub fn validation_layer() -> Result<Option<[u32; 3]>> {
    // SAFETY: loading the system's Vulkan loader runs its initialisers, as the caller asks.
    let entry = unsafe { ash::Entry::load() }.map_err(|e| Error::NoVulkan(e.to_string()))?;
    // SAFETY: a global command.
    let layers = unsafe { entry.enumerate_instance_layer_properties() }.named("vkEnumerateInstanceLayerProperties")?;
    let version = |v: u32| [vk::api_version_major(v), vk::api_version_minor(v), vk::api_version_patch(v)];
    Ok(layers.iter().find(|l| l.layer_name_as_c_str() == Ok(LAYER)).map(|l| version(l.spec_version)))
}
