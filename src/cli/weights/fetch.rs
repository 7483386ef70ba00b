//! Fetches public weights over HTTPS. A file is kept only if it has the published content.

use std::path::Path;
use std::time::Duration;

use anyhow::Context as _;
use psrgs_vk::format::atomic;
use psrgs_vk::perceptual::PublicFile;
use sha2::{Digest, Sha256};

use super::super::exit::Failure;

/// Most bytes of a download.
const MOST_BYTES: u64 = 64 << 20;
/// Longest wait for an answer.
const ANSWER: Duration = Duration::from_secs(30);
/// Longest time of a download.
const WHOLE: Duration = Duration::from_secs(600);

/// SHA-256 of bytes in hexadecimal.
pub(super) fn sum(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}

/// Fetches a file into the folder, from its own address or from one below `from`. Writes nothing after any failure.
pub(super) fn fetch(file: &PublicFile, from: Option<&str>, folder: &Path) -> anyhow::Result<()> {
    let address = match from {
        Some(base) => format!("{}/{}", base.trim_end_matches('/'), file.name),
        None => file.address.to_owned(),
    };
    let bytes = read(&address).with_context(|| {
        Failure::Input(format!(
            "{address} cannot be fetched; fetch it by other means, and put it into {} as {}",
            folder.display(),
            file.name
        ))
    })?;
    let got = sum(&bytes);
    if got != file.sha256 {
        return Err(Failure::Check(format!(
            "{address} is not the published file: SHA-256 {got} of {} bytes in place of {}; nothing was kept. \
             Something on the way has changed it, or there is another file now: put the published one into {} as {}",
            bytes.len(),
            file.sha256,
            folder.display(),
            file.name
        ))
        .into());
    }
    std::fs::create_dir_all(folder).with_context(|| Failure::Output(folder.display().to_string()))?;
    Ok(atomic::write(&folder.join(file.name), |out| out.write_all(&bytes))?)
}

fn read(address: &str) -> anyhow::Result<Vec<u8>> {
    let config = ureq::Agent::config_builder()
        .timeout_connect(Some(ANSWER))
        .timeout_recv_response(Some(ANSWER))
        .timeout_global(Some(WHOLE));
    let mut answer = ureq::Agent::from(config.build()).get(address).call()?;
    Ok(answer.body_mut().with_config().limit(MOST_BYTES).read_to_vec()?)
}
