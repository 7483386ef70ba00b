//! Shared by the fuzz targets: seeds, files for readers that take paths, and a bound on a reader's memory per file.
//!
//! A target begins with [`begin`] and passes every input to its reader inside [`within`]. It fails on a panic, on more
//! memory than the bound, or on more time than libFuzzer's `-timeout`.

pub mod bound;
pub mod checkpoints;
pub mod datasets;
pub mod scratch;
pub mod seeds;

pub use bound::within;
pub use scratch::Scratch;

/// Writes the seeds of a target and ends the process, if the environment asks for it (`PSRGS_FUZZ_SEEDS=FOLDER`).
///
/// Decoders of other crates panic on damaged data, and the readers contain these panics. So a panic does not end the
/// process: only a panic that leaves a reader is a finding, which libFuzzer's wrapper sees as it unwinds.
/// `PSRGS_FUZZ_PANICS=1` shows all panics.
pub fn begin(seeds: impl FnOnce() -> Vec<Vec<u8>>) {
    // libFuzzer's wrapper installs a hook that ends the process.
    drop(std::panic::take_hook());
    let default = std::panic::take_hook();
    let shown = std::env::var_os("PSRGS_FUZZ_PANICS").is_some();
    std::panic::set_hook(Box::new(move |info| {
        bound::lift();
        if shown {
            default(info);
        }
    }));
    let Some(folder) = std::env::var_os("PSRGS_FUZZ_SEEDS") else { return };
    let folder = std::path::PathBuf::from(folder);
    for (i, seed) in seeds().into_iter().enumerate() {
        std::fs::write(folder.join(format!("seed-{i:02}")), seed).expect("the folder for seeds can be written");
    }
    std::process::exit(0);
}

/// The first byte of an input, which makes a choice, and the rest.
pub fn choice(data: &[u8]) -> (usize, &[u8]) {
    data.split_first().map_or((0, data), |(first, rest)| (usize::from(*first), rest))
}

/// A seed with its choice in the first byte.
pub fn chosen(choice: u8, bytes: impl AsRef<[u8]>) -> Vec<u8> {
    [&[choice], bytes.as_ref()].concat()
}
