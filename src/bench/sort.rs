//! Keys per second of the radix sort.

use serde::Serialize;

use super::{Error, Quartiles};
use crate::pass::counters;
use crate::raster::sort::{KeyCount, RadixSort, SortShape};
use crate::vk::{Gpu, Memory, PassTime};

/// Results of a benchmark of the sort.
#[derive(Clone, Debug, Serialize)]
pub struct SortReport {
    /// Number of keys. Each key and each value has 32 bits.
    pub keys: u32,
    /// Bits of the keys that the sort compares.
    pub bits: u32,
    /// Variant of the passes.
    pub shape: String,
    /// Dispatches of a sort.
    pub dispatches: usize,
    /// Time of all dispatches on the device, milliseconds.
    pub ms: Quartiles,
    /// Milliseconds of each pass over all its dispatches in the last sort, by name.
    pub passes: Vec<(String, f64)>,
    /// Keys over the median time, 10^9 per second.
    pub gkeys_per_s: f64,
    /// Peak device memory in bytes.
    pub peak_device_bytes: u64,
}

/// Sorts `keys` random keys by their lowest `bits` bits, with their positions as values, `rounds` times from the same
/// start. Checks the last result on the host: keys ascend, equal keys have ascending values, and every value gives the
/// position of its key.
pub fn sort(gpu: &Gpu, keys: u32, bits: u32, rounds: u32) -> Result<SortReport, Error> {
    let bits = bits.clamp(1, 32);
    let n = u64::from(keys);
    let shape = SortShape::of(gpu.caps());
    let words = |name: &str| gpu.buffer(name, 4 * n.max(1), Memory::Device);
    let start = words("sort_start")?;
    let (key_sides, val_sides) =
        ([words("sort_keys0")?, words("sort_keys1")?], [words("sort_vals0")?, words("sort_vals1")?]);
    let counts = gpu.buffer("sort_counters", 4 * counters::COUNT as u64, Memory::Device)?;
    let sorter = RadixSort::new(gpu, "sort", shape, n, bits)?;
    let given: Vec<u32> = (0..keys).map(hash).collect();
    let places: Vec<u32> = (0..keys).collect();
    gpu.write(&start, &given)?;
    gpu.write(&counts, &[0u32; counters::COUNT])?;

    let (mut ms, mut passes, mut dispatches, mut side) = (Vec::new(), Vec::new(), 0, 0);
    // The first round is a warm-up.
    for round in 0..=rounds.max(1) {
        gpu.write(&val_sides[0], &places)?;
        let mut recorder = gpu.recorder("sort")?;
        recorder.profile(true);
        recorder.copy(&start, 0, &key_sides[0], 0, 4 * n)?;
        let before = recorder.len();
        let (k, v) = ([&key_sides[0], &key_sides[1]], [&val_sides[0], &val_sides[1]]);
        side = sorter.record(&mut recorder, k, v, &counts, KeyCount::Host(keys), bits)?;
        dispatches = recorder.len() - before;
        let ticket = recorder.submit()?;
        gpu.wait(ticket)?;
        let times = gpu.timings(ticket)?.unwrap_or_default();
        if round > 0 {
            ms.push(1e-6 * times.iter().skip(before).map(|t| t.ns).sum::<f64>());
            passes = by_pass(times.get(before..).unwrap_or_default());
        }
    }
    let ms = Quartiles::of(ms);
    check(
        &given,
        &gpu.read_at(&key_sides[side], 0, keys as usize)?,
        &gpu.read_at(&val_sides[side], 0, keys as usize)?,
        bits,
    )?;
    if ms.median <= 0.0 {
        return Err(Error::NotLive("the sort took no time at all".into()));
    }
    Ok(SortReport {
        keys,
        bits,
        shape: shape.to_string(),
        dispatches,
        ms,
        passes,
        gkeys_per_s: 1e-6 * f64::from(keys) / ms.median,
        peak_device_bytes: gpu.memory_use().peak,
    })
}

/// Milliseconds by name, in the order of first appearance.
fn by_pass(times: &[PassTime]) -> Vec<(String, f64)> {
    let mut sums: Vec<(String, f64)> = Vec::new();
    for time in times {
        match sums.iter_mut().find(|(name, _)| *name == time.pass) {
            Some((_, sum)) => *sum += 1e-6 * time.ns,
            None => sums.push((time.pass.clone(), 1e-6 * time.ns)),
        }
    }
    sums
}

/// A permutation of the words (finaliser of MurmurHash3): spreads the keys evenly.
fn hash(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x85eb_ca6b);
    x = (x ^ (x >> 13)).wrapping_mul(0xc2b2_ae35);
    x ^ (x >> 16)
}

/// Checks that `keys` and `vals` are `given` in sorted order.
fn check(given: &[u32], keys: &[u32], vals: &[u32], bits: u32) -> Result<(), Error> {
    let mask = ((1u64 << bits) - 1) as u32;
    let sorted = |i: usize| {
        let own = given.get(vals[i] as usize) == Some(&keys[i]);
        own && (i == 0 || (keys[i - 1] & mask, vals[i - 1]) < (keys[i] & mask, vals[i]))
    };
    match (0..given.len()).find(|&i| !sorted(i)) {
        Some(i) => Err(Error::NotLive(format!("the keys are not sorted at place {i}"))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn the_check_knows_what_is_sorted() {
        let given = [5, 1, 5, 0];
        assert!(check(&given, &[0, 1, 5, 5], &[3, 1, 0, 2], 32).is_ok());
        assert!(check(&given, &[0, 1, 5, 5], &[3, 1, 2, 0], 32).is_err(), "equal keys out of order");
        assert!(check(&given, &[0, 1, 5, 5], &[3, 1, 0, 0], 32).is_err(), "a value twice");
        assert!(check(&given, &[1, 0, 5, 5], &[1, 3, 0, 2], 32).is_err(), "descending");
        assert!(check(&given, &[0, 1, 5, 6], &[3, 1, 0, 2], 32).is_err(), "a key that was not there");
        assert!(check(&given, &[0, 5, 1, 5], &[3, 0, 1, 2], 2).is_ok(), "by the lowest bits alone");
    }
}
