//! Description of a compute shader for the device layer, as plain data.

use super::caps::Limits;
use super::shared_memory;

/// How a shader accesses a buffer. The recorder infers barriers from the access; a test compares the access with the
/// SPIR-V decorations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// The shader declares the buffer `readonly`.
    Read,
    /// The shader declares the buffer `writeonly`.
    Write,
    /// The shader reads and writes the buffer (atomics included).
    ReadWrite,
}

/// A storage buffer of a kernel: descriptor set 0, binding number = index in [`Kernel::bindings`].
#[derive(Clone, Copy, Debug)]
pub struct Binding {
    /// The instance name of the buffer block in the shader.
    pub name: &'static str,
    /// Declared access.
    pub access: Access,
}

/// A 32-bit specialization constant: `uint`, the bits of a `float`, or `bool` as 0 or 1.
#[derive(Clone, Copy, Debug)]
pub struct Constant {
    /// `constant_id` in the shader.
    pub id: u32,
    /// Name in the shader.
    pub name: &'static str,
    /// Value used when the caller gives none.
    pub default: u32,
}

/// A compute shader's module as SPIR-V words in bytes (a multiple of four), in up to four equivalent variants.
#[derive(Clone, Copy, Debug)]
pub struct Spirv {
    /// One descriptor per storage buffer.
    pub descriptors: &'static [u8],
    /// Storage buffers reached by address: the only descriptor, binding 0, is a table with the address of each buffer
    /// in binding order (64 bits, low word first).
    pub addresses: Option<&'static [u8]>,
    /// Rows of buffers read as texels, which software drivers read fastest.
    pub texels: Option<Texels>,
    /// Rows read as texels, and all other buffers reached by address: for buffers larger than a descriptor's range (a
    /// texel buffer may be larger).
    pub texels_by_address: Option<Texels>,
}

/// A variant of a module that reads rows of some buffers as texels.
#[derive(Clone, Copy, Debug)]
pub struct Texels {
    /// SPIR-V words as bytes.
    pub spirv: &'static [u8],
    /// The buffers read as texels.
    pub views: &'static [TexelView],
}

/// A buffer read as a uniform texel buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TexelView {
    /// Index of the buffer in [`Kernel::bindings`].
    pub binding: u32,
    /// Binding number of the texel buffer. When equal to the buffer's own binding, the buffer has no storage-buffer
    /// descriptor.
    pub at: u32,
    /// Format of a texel.
    pub format: TexelFormat,
}

/// Format of a row of a buffer, read as a texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TexelFormat {
    /// Three floats.
    Float3,
    /// Four floats.
    Float4,
    /// Four unsigned integers.
    Uint4,
}

impl TexelFormat {
    /// All formats.
    pub const ALL: [Self; 3] = [Self::Float3, Self::Float4, Self::Uint4];

    /// Bytes of a texel.
    pub fn bytes(self) -> u64 {
        match self {
            Self::Float3 => 12,
            Self::Float4 | Self::Uint4 => 16,
        }
    }
}

/// A compute shader and its interface.
#[derive(Clone, Copy, Debug)]
pub struct Kernel {
    /// Unique name for captures, validation messages and timings.
    pub name: &'static str,
    /// The module.
    pub spirv: Spirv,
    /// Storage buffers in binding order.
    pub bindings: &'static [Binding],
    /// Size of the push-constant block in bytes, at most 128; 0 for none.
    pub push_bytes: u32,
    /// Specialization constants.
    pub constants: &'static [Constant],
    /// Threads in a workgroup (flat: y and z are 1); `None` when a specialization constant sets it.
    pub local_size: Option<u32>,
}

impl Kernel {
    /// Bytes of shared memory of a workgroup. Constants missing in `given` (name, value) have their defaults. `None`
    /// when the module does not tell the size.
    pub fn shared_bytes(&self, given: &[(&str, u32)]) -> Option<u32> {
        let special = |id| {
            let constant = self.constants.iter().find(|c| c.id == id)?;
            let value = given.iter().find(|(name, _)| *name == constant.name).map(|(_, value)| *value);
            Some(value.unwrap_or(constant.default))
        };
        let bytes = shared_memory::bytes(&words(self.spirv.descriptors), special)?;
        u32::try_from(bytes).ok()
    }

    /// Whether the kernel's shared memory fits into the device's limit.
    pub fn fits(&self, limits: &Limits, given: &[(&str, u32)]) -> bool {
        self.shared_bytes(given).is_none_or(|bytes| bytes <= limits.shared_bytes)
    }
}

/// The words of a module.
pub(super) fn words(spirv: &[u8]) -> Vec<u32> {
    spirv.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

/// A [`Binding`] that the shader only reads.
pub const fn read(name: &'static str) -> Binding {
    Binding { name, access: Access::Read }
}

/// A [`Binding`] that the shader only writes.
pub const fn write(name: &'static str) -> Binding {
    Binding { name, access: Access::Write }
}

/// A [`Binding`] that the shader reads and writes.
pub const fn read_write(name: &'static str) -> Binding {
    Binding { name, access: Access::ReadWrite }
}
