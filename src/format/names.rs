//! Names of files made from photographs: of bounded length, and unique also on file systems that ignore case or Unicode
//! form. A name that needs no change stays unchanged.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::path::{Component, Path, PathBuf};

use sha2::{Digest, Sha256};
use unicode_normalization::UnicodeNormalization as _;

/// Most bytes of a file name.
const LONGEST: usize = 255;
/// Longer relative paths are flattened: a whole path may have 4096 bytes.
const LONGEST_PATH: usize = 1024;

/// A name per photograph, without extension and with `_` for `/`. Equal names get numbers. Each name leaves room for a
/// suffix of `ending` bytes.
pub fn flat(photographs: &[&str], ending: usize) -> Vec<String> {
    let plain = photographs.iter().map(|name| flattened(name));
    unique(plain.collect(), |name, number| format!("{}{number}", bounded(name, LONGEST - ending - number.len())))
}

/// [`flat`], but with the photographs' folders. No path leads out of the folder that it is joined to.
pub fn nested(photographs: &[&str], ending: usize) -> Vec<PathBuf> {
    let plain = photographs.iter().map(|name| inside(name)).collect();
    let fitted = |name: &str, number: &str| {
        if name.len() > LONGEST_PATH {
            return format!("{}{number}", bounded(&name.replace('/', "_"), LONGEST - ending - number.len()));
        }
        let mut parts: Vec<String> = name.split('/').map(|part| bounded(part, LONGEST)).collect();
        if let Some(last) = parts.last_mut() {
            *last = format!("{}{number}", bounded(last, LONGEST - ending - number.len()));
        }
        parts.join("/")
    };
    unique(plain, fitted).into_iter().map(PathBuf::from).collect()
}

/// A name of at most `most` bytes: the name itself, or its beginning and a hash of the whole name.
pub fn bounded(name: &str, most: usize) -> String {
    if name.len() <= most {
        return name.to_owned();
    }
    let mut sum = String::from("~");
    for byte in Sha256::digest(name.as_bytes()).iter().take(8) {
        // Writing to a String cannot fail.
        let _ = write!(sum, "{byte:02x}");
    }
    let mut end = most.saturating_sub(sum.len());
    while !name.is_char_boundary(end) {
        end -= 1;
    }
    format!("{}{sum}", &name[..end])
}

fn flattened(name: &str) -> String {
    Path::new(name).with_extension("").to_string_lossy().replace(['/', '\\', '\0'], "_")
}

/// The parts of a name between `/`, without parts that lead elsewhere.
fn inside(name: &str) -> String {
    let name = name.replace('\0', "_");
    let path = Path::new(&name).with_extension("");
    let part = |component: Component<'_>| match component {
        Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
        Component::ParentDir => Some("_".to_owned()),
        Component::CurDir | Component::RootDir | Component::Prefix(_) => None,
    };
    let parts: Vec<String> = path.components().filter_map(part).collect();
    if parts.is_empty() { "_".to_owned() } else { parts.join("/") }
}

/// The form in which the most lenient file systems compare names.
fn folded(name: &str) -> String {
    name.nfc().collect::<String>().to_lowercase().nfc().collect()
}

/// Fits names into their length, and numbers those that would share a file.
fn unique(plain: Vec<String>, fitted: impl Fn(&str, &str) -> String) -> Vec<String> {
    let mut count: HashMap<String, usize> = HashMap::new();
    for name in &plain {
        *count.entry(folded(&fitted(name, ""))).or_default() += 1;
    }
    let alone = |name: &str| count.get(&folded(&fitted(name, ""))).is_none_or(|n| *n < 2);
    // Names without a number come first because they cannot change.
    let mut taken: HashMap<String, ()> =
        plain.iter().filter(|name| alone(name)).map(|name| (folded(&fitted(name, "")), ())).collect();
    let mut one = |(i, name): (usize, &String)| {
        if alone(name) {
            return fitted(name, "");
        }
        let mut number = format!("-{i}");
        while taken.contains_key(&folded(&fitted(name, &number))) {
            number = format!("{number}-{i}");
        }
        let found = fitted(name, &number);
        taken.insert(folded(&found), ());
        found
    };
    plain.iter().enumerate().map(&mut one).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    const ENDING: usize = 15;

    #[test]
    fn no_two_photographs_share_a_file() {
        assert_eq!(flat(&["a.jpg", "left/b.v2.png"], ENDING), ["a", "left_b.v2"]);
        let names = ["a.jpg", "A.png", "x/y.jpg", "x_y.jpg", "z"];
        assert_eq!(flat(&names, ENDING), ["a-0", "A-1", "x_y-2", "x_y-3", "z"]);
        // A number must not make a name equal to another one.
        assert_eq!(flat(&["a-1.png", "a.jpg", "a.png"], ENDING), ["a-1", "a-1-1", "a-2"]);
        assert_eq!(flat(&["a.jpg", "a.png", "A-0.png", "a-1.jpg", "a-1-1.jpg"], ENDING)[..2], ["a-0-0", "a-1-1-1"]);
        // One letter in two Unicode forms, which some file systems treat as equal.
        assert_eq!(flat(&["\u{e9}.jpg", "e\u{301}.png"], ENDING), ["\u{e9}-0", "e\u{301}-1"]);
        let paths = |names: &[&str]| nested(names, 4).iter().map(|p| p.display().to_string()).collect::<Vec<_>>();
        assert_eq!(paths(&["l/a.jpg", "r/a.jpg", "b.png"]), ["l/a", "r/a", "b"]);
        assert_eq!(paths(&["l/a.jpg", "L/a.png", "l/a-0.png"]), ["l/a-0-0", "L/a-1", "l/a-0"]);
    }

    #[test]
    fn names_of_any_length_give_files_that_can_be_written() {
        let long = "n".repeat(241);
        let deep = vec!["folder with a name"; 300].join("/");
        let wide = "\u{1f5fb}".repeat(80);
        let mut names: Vec<String> = ["a", "b"].iter().map(|end| format!("{}{end}.jpg", "m".repeat(300))).collect();
        names.extend([
            format!("{long}.jpg"),
            format!("{long}/{long}.png"),
            format!("{deep}/x.jpg"),
            format!("{deep}/y.jpg"),
            wide,
        ]);
        names.extend(["M", "m"].iter().map(|start| format!("{start}{}.jpg", "m".repeat(299))));
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let folder = tempfile::tempdir().unwrap();
        let mut seen = HashSet::new();
        for name in flat(&names, ENDING) {
            let file = folder.path().join(format!("{name}.photograph.png"));
            std::fs::write(&file, "").unwrap();
            assert!(seen.insert(folded(&name)), "{name}");
        }
        for path in nested(&names, 4) {
            let file = folder.path().join("depth").join(format!("{}.exr", path.display()));
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            assert!(!file.exists(), "{}", file.display());
            std::fs::write(&file, "").unwrap();
        }
        // A fitting name is unchanged.
        let fits = "n".repeat(255 - ENDING);
        assert_eq!(flat(&[&fits], ENDING), [fits.as_str()]);
    }

    #[test]
    fn names_do_not_lead_out_of_their_folder() {
        for (name, inside) in
            [("../../a.jpg", "_/_/a"), ("/etc/a.jpg", "etc/a"), ("x/../a.jpg", "x/_/a"), ("..", "_"), ("", "_")]
        {
            assert_eq!(nested(&[name], 4), [PathBuf::from(inside)], "{name}");
        }
        assert_eq!(flat(&["../a.jpg", "a\0b.jpg"], ENDING), [".._a", "a_b"]);
    }
}
