//! `psrgs-vk weights`: lists and fetches the weights of `lpips_squeeze`.

mod fetch;

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use psrgs_vk::perceptual::{LpipsWeights, PUBLIC_FILES, PublicFile};

use super::console::{self, Console};
use super::exit::Failure;
use super::lpips;
use psrgs_vk::numbers::grouped;

/// List the public weights of lpips_squeeze: addresses, sizes, licences, checksums, and which are there
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  psrgs-vk weights                            where to get them, and where to put them
  psrgs-vk weights --fetch                    get them, and keep them where they are looked for
  psrgs-vk weights --dir my-weights --check   whether a folder has what is needed")]
pub(crate) struct Args {
    /// Folder of the weights [default: psrgs-vk/weights in the user's data folder]
    #[arg(long, value_name = "DIR", env = "PSRGS_WEIGHTS", hide_env_values = true)]
    dir: Option<PathBuf>,
    /// Download the files that are not there, and keep those whose SHA-256 is the published one
    #[arg(long)]
    fetch: bool,
    /// Download from here: an address under which the files have their names [default: where they were published]
    #[arg(long, value_name = "URL", requires = "fetch")]
    from: Option<String>,
    /// Fail unless the folder's weights can be read and fit each other
    #[arg(long)]
    check: bool,
}

pub(crate) fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let folder = args.dir.clone().or_else(lpips::folder);
    let folder = folder.context("there is no home folder to look in: name one with --dir")?;
    if args.fetch {
        fetch_all(&folder, args.from.as_deref(), console)?;
    }
    let mut text =
        format!("Put these files into {} (or into a folder that --perceptual-weights names):\n", folder.display());
    let found = LpipsWeights::find(&folder);
    let used = found.as_ref().ok().map(LpipsWeights::files);
    for (k, file) in PUBLIC_FILES.iter().enumerate() {
        let size = file.bytes.map_or_else(|| "about 5 MB".to_owned(), |n| format!("{} bytes", grouped(n)));
        // Writing to a String cannot fail.
        let _ = write!(
            text,
            "\n{}  ({})\n  {}\n  {size}, {}\n  SHA-256 {}\n  {}\n",
            file.name,
            file.what,
            file.address,
            file.licence,
            file.sha256,
            state(&folder, file, used.map(|used| used[k]))?
        );
    }
    if let Some([trunk, linear]) = used {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "\nusable: {}, {}", trunk.display(), linear.display());
    }
    console::print(&text)?;
    if args.check {
        found?;
    }
    Ok(())
}

/// Fetches the missing files. A failed download does not stop the others.
fn fetch_all(folder: &Path, from: Option<&str>, console: &Console) -> anyhow::Result<()> {
    let mut failed = None;
    for file in &PUBLIC_FILES {
        if sum_of(&folder.join(file.name))?.as_deref() == Some(file.sha256) {
            console.say(format_args!("{}: there already", file.name));
            continue;
        }
        match fetch::fetch(file, from, folder) {
            Ok(()) => console.say(format_args!("{}: fetched, as published ({})", file.name, file.licence)),
            Err(problem) => failed = failed.or(Some(problem)),
        }
    }
    failed.map_or(Ok(()), Err)
}

/// Whether the file is in the folder with the published content. `used` is another file that is read in its place.
fn state(folder: &Path, file: &PublicFile, used: Option<&Path>) -> anyhow::Result<String> {
    Ok(match sum_of(&folder.join(file.name))? {
        None => match used {
            Some(used) => format!("not needed: {} is read in its place", used.display()),
            None => "not there".to_owned(),
        },
        Some(sum) if sum == file.sha256 => "there, as published".to_owned(),
        Some(sum) => format!("there, with other content: SHA-256 {sum}"),
    })
}

/// The SHA-256 of a file; `None` where the file does not exist.
fn sum_of(path: &Path) -> anyhow::Result<Option<String>> {
    if !path.is_file() {
        return Ok(None);
    }
    let bytes = fs::read(path).with_context(|| Failure::Input(path.display().to_string()))?;
    Ok(Some(fetch::sum(&bytes)))
}
