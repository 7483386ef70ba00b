//! `psrgs-vk weights`: where the weights of `lpips_squeeze` come from.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use psrgs_vk::perceptual::{LpipsWeights, PUBLIC_FILES, PublicFile};
use sha2::{Digest, Sha256};

use super::console;
use super::exit::Failure;
use super::lpips;

/// List the public weights of lpips_squeeze: addresses, sizes, licences, checksums, and which are there
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk weights                            where to get them, and where to put them
  psrgs-vk weights --dir my-weights --check   whether a folder has what is needed")]
pub(crate) struct Args {
    /// Folder of the weights [default: psrgs-vk/weights in the user's data folder]
    #[arg(long, value_name = "DIR", env = "PSRGS_WEIGHTS", hide_env_values = true)]
    dir: Option<PathBuf>,
    /// Fail unless the folder's weights can be read and fit each other
    #[arg(long)]
    check: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let folder = args.dir.clone().or_else(lpips::folder);
    let folder = folder.context("there is no home folder to look in: name one with --dir")?;
    let mut text =
        format!("Put these files into {} (or into a folder that --perceptual-weights names):\n", folder.display());
    for file in &PUBLIC_FILES {
        let size = file.bytes.map_or_else(|| "about 5 MB".to_owned(), |n| format!("{n} bytes"));
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "\n{}  ({})\n  {}\n  {size}, {}\n  SHA-256 {}\n  {}\n",
            file.name,
            file.what,
            file.address,
            file.licence,
            file.sha256,
            state(&folder, file)?
        );
    }
    console::print(&text)?;
    if args.check {
        let weights = LpipsWeights::find(&folder)?;
        let [trunk, linear] = weights.files().map(|f| f.display().to_string());
        console::print(&format!("\nusable: {trunk}, {linear}\n"))?;
    }
    Ok(())
}

/// Whether the file is in the folder, and is the one that is meant.
fn state(folder: &Path, file: &PublicFile) -> anyhow::Result<String> {
    let path = folder.join(file.name);
    if !path.is_file() {
        return Ok("not there".to_owned());
    }
    let bytes = fs::read(&path).with_context(|| Failure::Input(path.display().to_string()))?;
    let sum: String = Sha256::digest(&bytes).iter().map(|b| format!("{b:02x}")).collect();
    Ok(if sum == file.sha256 {
        "there, as published".to_owned()
    } else {
        format!("there, with other content: SHA-256 {sum}")
    })
}
