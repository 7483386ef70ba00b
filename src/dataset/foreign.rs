//! Recognises camera files of other programs that cannot be read, and says what to export instead.

use std::fs::{self, File};
use std::io::Read as _;
use std::path::{Path, PathBuf};

use super::names::is_hidden;

/// Bytes of a file that are read to recognise it.
const BEGINNING: u64 = 4096;
/// Levels of folders below the dataset that are searched.
const DEEPEST: usize = 3;
/// Most entries that are looked at.
const LOOKED_AT: usize = 2000;

/// A kind of camera file. `is` recognises it by its name in lower case and its first bytes.
struct CameraFileKind {
    what: &'static str,
    is: fn(&str, &[u8]) -> bool,
    remedy: &'static str,
}

fn holds(bytes: &[u8], word: &str) -> bool {
    bytes.windows(word.len()).any(|window| window.eq_ignore_ascii_case(word.as_bytes()))
}

/// The first line in lower case, without a byte order mark.
fn first_line(bytes: &[u8]) -> String {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let line = bytes.split(|b| matches!(b, b'\n' | b'\r')).next().unwrap_or_default();
    String::from_utf8_lossy(line).to_lowercase()
}

const KINDS: &[CameraFileKind] = &[
    CameraFileKind {
        what: "cameras of Metashape (XML)",
        is: |name, bytes| name.ends_with(".xml") && holds(bytes, "<document") && holds(bytes, "<chunk"),
        remedy: "export them from Metashape as COLMAP (File, Export, Export Cameras)",
    },
    CameraFileKind {
        what: "a project of Metashape",
        is: |name, _| name.ends_with(".psx") || name.ends_with(".psz"),
        remedy: "export its cameras from Metashape as COLMAP (File, Export, Export Cameras)",
    },
    CameraFileKind {
        what: "cameras in the format BlocksExchange (XML)",
        is: |name, bytes| name.ends_with(".xml") && holds(bytes, "<BlocksExchange"),
        remedy: "export them as COLMAP from the program that wrote them",
    },
    CameraFileKind {
        what: "cameras of RealityCapture (CSV)",
        is: |name, bytes| {
            let line: String = first_line(bytes).split_whitespace().collect();
            name.ends_with(".csv") && (line.starts_with("#name,x,y,") || line.starts_with("#cameras,"))
        },
        remedy: "export the registration from RealityCapture (RealityScan) as COLMAP",
    },
    CameraFileKind {
        what: "a project of RealityCapture",
        is: |name, _| name.ends_with(".rcproj") || name.ends_with(".rsproj"),
        remedy: "export the registration from RealityCapture (RealityScan) as COLMAP",
    },
    CameraFileKind {
        what: "cameras of LLFF (poses_bounds.npy)",
        is: |name, _| name.starts_with("poses_bounds") && name.ends_with(".npy"),
        remedy: "take the COLMAP model that they were made from (sparse/0), or reconstruct the photographs with COLMAP",
    },
    CameraFileKind {
        what: "a model of Bundler (.out)",
        is: |name, bytes| name.ends_with(".out") && first_line(bytes).starts_with("# bundle file"),
        remedy: "export the cameras as COLMAP from the program that wrote them, or reconstruct the photographs with \
            COLMAP",
    },
    CameraFileKind {
        what: "a model of VisualSFM (.nvm)",
        is: |name, bytes| name.ends_with(".nvm") || first_line(bytes).starts_with("nvm_v3"),
        remedy: "export the cameras as COLMAP from the program that wrote them, or reconstruct the photographs with \
            COLMAP",
    },
    CameraFileKind {
        what: "cameras of Pix4D",
        is: |name, _| {
            let parameters =
                name.contains("calibrated_camera_parameters") || name.contains("calibrated_external_camera");
            parameters || name.ends_with("_pmatrix.txt") || name.ends_with(".p4d") || name.ends_with(".opf")
        },
        remedy: "export the project as OPF from Pix4D and make a COLMAP model of it (opf2colmap of Pix4D's pyopf)",
    },
    CameraFileKind {
        what: "cameras of Meshroom (AliceVision)",
        is: |name, bytes| name.ends_with(".sfm") || (name.ends_with(".json") && holds(bytes, "\"featuresFolders\"")),
        remedy: "export them as COLMAP (Meshroom's node ExportColmap)",
    },
    CameraFileKind {
        what: "cameras of OpenMVG (sfm_data)",
        is: |name, bytes| {
            name.starts_with("sfm_data") && (name.ends_with(".bin") || holds(bytes, "\"sfm_data_version\""))
        },
        remedy: "export them as COLMAP (openMVG_main_openMVG2Colmap)",
    },
    CameraFileKind {
        what: "cameras that a trainer of splats has written (cameras.json)",
        is: |name, bytes| name == "cameras.json" && holds(bytes, "\"img_name\""),
        remedy: "take the dataset that was trained on",
    },
    CameraFileKind {
        what: "a database of COLMAP, with features and matches and no cameras",
        is: |name, bytes| name.ends_with(".db") && bytes.starts_with(b"SQLite format 3"),
        remedy: "colmap mapper makes a model of it (docs/GUIDE.md, section 2)",
    },
];

/// Describes the first camera file that cannot be read; `None` without one.
pub(super) fn cameras_in(folder: &Path) -> Option<String> {
    let files = files_below(folder);
    let said = |file: &PathBuf| {
        let name = file.file_name()?.to_str()?.to_lowercase();
        let bytes = beginning(file);
        KINDS.iter().position(|kind| (kind.is)(&name, &bytes)).map(|at| (at, file.clone()))
    };
    let (at, file) = files.iter().filter_map(said).min()?;
    let kind = KINDS.get(at)?;
    let place = file.strip_prefix(folder).unwrap_or(&file);
    let is = if kind.what.starts_with("a ") { "is" } else { "are" };
    Some(format!("there {is} {}, which {is} not read: {}; {}", kind.what, place.display(), kind.remedy))
}

/// Describes an incomplete COLMAP model; `None` without one.
pub(super) fn incomplete_model(folder: &Path) -> Option<String> {
    let files = files_below(folder);
    let place = |file: &Path| file.strip_prefix(folder).unwrap_or(file).display().to_string();
    for file in &files {
        let (Some(name), Some(inside)) = (file.file_name().and_then(|name| name.to_str()), file.parent()) else {
            continue;
        };
        let (there, extension) = match name.split_once('.') {
            Some((there @ ("cameras" | "images"), extension @ ("bin" | "txt"))) => (there, extension),
            _ => continue,
        };
        let lacking = if there == "cameras" { "images" } else { "cameras" };
        let (same, other) = (format!("{lacking}.{extension}"), if extension == "bin" { "txt" } else { "bin" });
        if inside.join(&same).is_file() || inside.join(format!("{there}.{other}")).is_file() {
            continue;
        }
        let also = inside.join(format!("{lacking}.{other}"));
        return Some(match also.is_file() {
            true => format!(
                "{} and {} are of one model, and both have to be .bin or both .txt: colmap model_converter writes \
                 either",
                place(file),
                place(&also)
            ),
            false => format!("there is a part of a COLMAP model, {}, and {same} is not beside it", place(file)),
        });
    }
    None
}

/// Files in a folder and its subfolders, sorted by name, without hidden files.
fn files_below(folder: &Path) -> Vec<PathBuf> {
    let (mut found, mut looked_at) = (Vec::new(), 0);
    let mut folders = std::collections::VecDeque::from([(folder.to_owned(), 0)]);
    while let Some((folder, depth)) = folders.pop_front() {
        let mut entries: Vec<PathBuf> =
            fs::read_dir(&folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
        entries.retain(|path| !is_hidden(path) && !super::folder::is_photograph(path));
        entries.sort();
        for path in entries {
            looked_at += 1;
            if looked_at > LOOKED_AT {
                return found;
            }
            // Pipes and devices are neither files nor folders.
            match fs::metadata(&path) {
                Ok(meta) if meta.is_dir() && depth < DEEPEST => folders.push_back((path, depth + 1)),
                Ok(meta) if meta.is_file() => found.push(path),
                _ => {}
            }
        }
    }
    found
}

fn beginning(file: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    if let Ok(opened) = File::open(file) {
        // An unreadable file has no beginning.
        let _ = opened.take(BEGINNING).read_to_end(&mut bytes);
    }
    bytes
}
