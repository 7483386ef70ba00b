//! Runs a pass on the device in each of its variants, and its twin on the CPU, on equal buffers.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use psrgs_vk::pass::Pass;
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::{self, TwinCall};
use psrgs_vk::vk::{Addresses, DeviceKind, Gpu, Groups, Memory};

/// The buffers after a dispatch, in binding order.
pub struct Outcome {
    /// From the device, through descriptors; within [`each_way`] also in other ways.
    pub device: Vec<Vec<u8>>,
    /// From the device, by address, on devices where [`rounds_alike`] holds. Equal bits, except for passes that add
    /// floats in the order in which threads arrive.
    pub by_address: Option<Vec<Vec<u8>>>,
    /// From the twin.
    pub twin: Vec<Vec<u8>>,
}

impl Outcome {
    /// Buffer `i` as the device left it.
    pub fn device<T: bytemuck::AnyBitPattern>(&self, i: usize) -> Vec<T> {
        values(&self.device[i])
    }

    /// Buffer `i` as the twin left it.
    pub fn twin<T: bytemuck::AnyBitPattern>(&self, i: usize) -> Vec<T> {
        values(&self.twin[i])
    }

    /// Fails unless device and twin left the same bits in every buffer, garbage included.
    pub fn assert_same_bits(&self, what: &str) {
        for (i, (device, twin)) in self.device.iter().zip(&self.twin).enumerate() {
            if let Some(at) = device.chunks(4).zip(twin.chunks(4)).position(|(d, t)| d != t) {
                let word = |bytes: &[u8]| values::<u32>(&bytes[4 * at..4 * at + 4])[0];
                panic!("{what}: buffer {i}, word {at}: device {:#x}, twin {:#x}", word(device), word(twin));
            }
        }
    }
}

fn values<T: bytemuck::AnyBitPattern>(bytes: &[u8]) -> Vec<T> {
    bytes.chunks_exact(size_of::<T>()).map(bytemuck::pod_read_unaligned).collect()
}

/// A buffer's content.
pub fn bytes<T: bytemuck::NoUninit>(values: &[T]) -> Vec<u8> {
    bytemuck::cast_slice(values).to_vec()
}

/// How a dispatch accesses its buffers.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    /// As in training.
    Usual,
    ByAddress,
    /// Rows as texels, and everything else by address.
    TexelsByAddress,
    /// With a descriptor per buffer, even where the device reads rows as texels.
    WithoutTexels,
}

/// Whether every variant of a pass rounds alike, with correctly rounded quotients and roots: on CPUs. A compiler for a
/// GPU may contract products and sums differently in each form, and divides within 2.5 ulp.
pub fn rounds_alike(gpu: &Gpu) -> bool {
    gpu.caps().kind == DeviceKind::Cpu
}

thread_local! {
    static WAY: Cell<Way> = const { Cell::new(Way::Usual) };
}

/// Runs a case once on devices where all variants of a pass leave equal bits, which [`run`] checks. Elsewhere runs the
/// case in each way of access, so that each form is held to the case's bounds.
pub fn each_way(gpu: &Gpu, case: fn(&Gpu)) {
    case(gpu);
    if rounds_alike(gpu) {
        return;
    }
    let texels: &[Way] = if gpu.caps().texels { &[Way::WithoutTexels, Way::TexelsByAddress] } else { &[] };
    for way in [Way::ByAddress].iter().chain(texels) {
        WAY.set(*way);
        case(gpu);
        WAY.set(Way::Usual);
    }
}

/// Whether the pass has a variant of its own for this way.
fn has(gpu: &Gpu, pass: &Pass, way: Way) -> bool {
    match way {
        Way::Usual | Way::ByAddress => true,
        Way::WithoutTexels => gpu.caps().texels && pass.kernel.spirv.texels.is_some(),
        Way::TexelsByAddress => gpu.caps().texels && pass.kernel.spirv.texels_by_address.is_some(),
    }
}

/// Copies of `buffers` after a dispatch on the device.
fn dispatch<P: bytemuck::NoUninit>(
    gpu: &Gpu,
    pass: &Pass,
    given: &[(&str, u32)],
    buffers: &[Vec<u8>],
    push: &P,
    groups: u32,
    way: Way,
) -> Vec<Vec<u8>> {
    let pipeline = gpu.pipeline(&pass.kernel, given).unwrap();
    let mut recorder = gpu.recorder(pass.kernel.name).unwrap();
    let mut bound = Vec::new();
    for (content, binding) in buffers.iter().zip(pass.kernel.bindings) {
        let buffer = gpu.buffer(binding.name, content.len() as u64, Memory::Device).unwrap();
        recorder.upload(&buffer, 0, content).unwrap();
        bound.push(buffer);
    }
    let all: Vec<_> = bound.iter().collect();
    let by_address = matches!(way, Way::ByAddress | Way::TexelsByAddress);
    recorder.force_addresses(Some(by_address));
    recorder.force_texels(match way {
        Way::Usual => None,
        Way::TexelsByAddress => Some(true),
        Way::ByAddress | Way::WithoutTexels => Some(false),
    });
    recorder.dispatch(&pipeline, &all, push, Groups::Workgroups(u64::from(groups))).unwrap();
    let before = gpu.stats().by_address;
    recorder.submit().unwrap();
    if gpu.caps().addresses != Addresses::Never {
        assert_eq!(gpu.stats().by_address - before, u64::from(by_address && groups > 0), "{}", pass.kernel.name);
    }
    bound.iter().map(|buffer| gpu.read(buffer).unwrap()).collect()
}

/// Whether a pass leaves equal bits in every run: not where floats are added, or places are given out, in the order in
/// which threads arrive.
fn repeats(pass: &Pass) -> bool {
    let name = pass.kernel.name;
    !["_atomic", "_cas"].iter().any(|ending| name.ends_with(ending)) && !name.starts_with("emit_tiles")
}

/// Index of the constants among the sets with which a pass is run. Only the first sets run in the other variants: a
/// driver on a CPU takes up to seconds for the pipeline of a set, and access to buffers does not depend on constants.
fn place_of_set(pass: &Pass, given: &[(&str, u32)]) -> usize {
    static SETS: Mutex<BTreeMap<&str, Vec<String>>> = Mutex::new(BTreeMap::new());
    let set = format!("{given:?}");
    let mut all = SETS.lock().unwrap_or_else(PoisonError::into_inner);
    let sets = all.entry(pass.kernel.name).or_default();
    sets.iter().position(|s| *s == set).unwrap_or_else(|| {
        sets.push(set);
        sets.len() - 1
    })
}

/// Runs `groups` workgroups of the pass and of its twin on copies of `buffers`. Where [`rounds_alike`] holds, fails
/// unless all variants of the pass leave equal bits. For a pass that does not repeat its bits, the case has to check
/// [`Outcome::by_address`] as well.
pub fn run<P: bytemuck::NoUninit>(
    gpu: &Gpu,
    pass: &Pass,
    given: &[(&str, u32)],
    buffers: &[Vec<u8>],
    push: &P,
    groups: u32,
) -> Outcome {
    let on_device = |way| dispatch(gpu, pass, given, buffers, push, groups, way);
    let way = WAY.get();
    let device = on_device(if has(gpu, pass, way) { way } else { Way::Usual });
    let place = if rounds_alike(gpu) { place_of_set(pass, given) } else { usize::MAX };
    let beside = |way, sets| (place < sets && has(gpu, pass, way)).then(|| on_device(way));
    let by_address = beside(Way::ByAddress, 2);
    let plain = beside(Way::WithoutTexels, 1);
    let both = beside(Way::TexelsByAddress, 1);
    for (form, other) in [("by address", &by_address), ("without texels", &plain), ("by address, with texels", &both)] {
        if let (Some(other), true) = (other, repeats(pass)) {
            for (i, (device, other)) in device.iter().zip(other).enumerate() {
                assert!(device == other, "{}: {form}, buffer {i} has other bits", pass.kernel.name);
            }
        }
    }

    let constant = |name: &str, default| given.iter().find(|(n, _)| *n == name).map_or(default, |&(_, value)| value);
    let constants: Vec<u32> = pass.kernel.constants.iter().map(|c| constant(c.name, c.default)).collect();
    let mut twin = buffers.to_vec();
    let push = bytemuck::bytes_of(push);
    twin::of(pass).expect("a twin")(&mut TwinCall { buffers: &mut twin, push, constants: &constants, groups });
    Outcome { device, by_address, twin }
}

/// Random 32-bit words, for the device's buffers.
pub trait Words {
    /// The next word.
    fn word(&mut self) -> u32;

    /// Uniform in [low, high).
    fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * (self.word() >> 8) as f32 / (1u32 << 24) as f32
    }

    /// Words.
    fn words(&mut self, count: usize) -> Vec<u32> {
        (0..count).map(|_| self.word()).collect()
    }
}

impl Words for Random {
    fn word(&mut self) -> u32 {
        (self.bits() >> 32) as u32
    }
}

/// `count` meaningless words, for buffers that a pass writes.
pub fn garbage(count: usize) -> Vec<u8> {
    bytes(&Random::new(count as u64 + 77).words(count))
}
