//! Finds files whose name differs a little from the one asked for: by letter case, separators, leading folders,
//! extension or Unicode form. Serves photographs, masks, ground truth maps and clouds of every format.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::fmt;
use std::fs;
use std::path::{Component, Path};

use unicode_normalization::{UnicodeNormalization as _, is_nfc};

/// Levels of folders that are listed: links may form loops.
const DEEPEST: usize = 12;
/// Most files that are listed.
const MOST_FILES: usize = 1_000_000;
/// Extensions of pictures, which may replace one another.
const PICTURES: [&str; 9] = ["jpg", "jpeg", "png", "exr", "tif", "tiff", "webp", "jpe", "bmp"];

/// The files below a folder, indexed by the comparable part of their names.
pub(crate) struct Names {
    files: Vec<Name>,
    by_stem: HashMap<String, Vec<usize>>,
}

/// A name in its parts, and in the forms that are compared.
struct Name {
    /// The name with `/` between the parts.
    text: String,
    /// The parts in Unicode's composed form.
    parts: Vec<String>,
    /// The parts in lower case, the last one without its extension.
    folded: Vec<String>,
    /// The extension in lower case; empty where it is unknown.
    extension: String,
    /// Whether the name leads out of the folder.
    outside: bool,
    /// Whether the name has `\` as separator, or parts that lead nowhere (`./`, `a/../`).
    separators: bool,
    /// Whether the last part is in Unicode's composed form.
    composed: bool,
}

/// The file for a name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum NameMatch {
    /// A file has this name (the first matching form).
    AsNamed(String),
    /// One file has a name with these differences.
    Otherwise(String, Differences),
    /// Several files have equally similar names, or several names match one file.
    Unclear(Vec<String>),
    /// No file has a similar name.
    Missing,
}

impl NameMatch {
    /// The name of the file, where there is one.
    pub(crate) fn file(&self) -> Option<&str> {
        match self {
            Self::AsNamed(file) | Self::Otherwise(file, _) => Some(file),
            Self::Unclear(_) | Self::Missing => None,
        }
    }

    pub(crate) fn into_file(self) -> Option<String> {
        match self {
            Self::AsNamed(file) | Self::Otherwise(file, _) => Some(file),
            Self::Unclear(_) | Self::Missing => None,
        }
    }
}

/// How a name differs from that of its file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Differences {
    /// `\` in place of `/`, or parts that lead nowhere.
    pub separators: bool,
    /// The Unicode form of letters with marks.
    pub unicode: bool,
    /// Upper and lower case.
    pub case: bool,
    /// The extension.
    pub extension: bool,
    /// Leading folders that one of the names lacks.
    pub prefix: bool,
    /// The name leads out of the dataset; its last part was looked for inside.
    pub outside: bool,
}

impl fmt::Display for Differences {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = [
            (self.separators && !self.outside, "separators"),
            (self.prefix && !self.outside, "folders before the name"),
            (self.case, "letter case"),
            (self.extension, "extension"),
            (self.unicode, "Unicode form"),
            (self.outside, "a path that leads out of the dataset, which is not followed"),
        ];
        let words: Vec<&str> = words.into_iter().filter_map(|(is, word)| is.then_some(word)).collect();
        f.write_str(&words.join(" and "))
    }
}

/// Similarity of two names, the most similar first: whether leading folders are lacking or different, the number of
/// shared parts, whether extensions differ, and whether the letter case does.
type Rank = (u8, std::cmp::Reverse<usize>, bool, bool);

impl Names {
    /// Lists the files below a folder whose path there is `wanted`, without hidden files.
    pub(crate) fn below(root: &Path, wanted: impl Fn(&Path) -> bool) -> Self {
        let mut found = Vec::new();
        let mut folders = vec![(root.to_owned(), String::new(), 0)];
        let mut linked = HashSet::new();
        while let Some((folder, inside, depth)) = folders.pop() {
            for entry in fs::read_dir(&folder).into_iter().flatten().flatten() {
                let Ok(name) = entry.file_name().into_string() else { continue };
                if is_hidden(Path::new(&name)) || found.len() >= MOST_FILES {
                    continue;
                }
                let (path, inside) = (entry.path(), format!("{inside}{name}"));
                let link = entry.file_type().is_ok_and(|kind| kind.is_symlink());
                let Ok(meta) = fs::metadata(&path) else { continue };
                if meta.is_dir() {
                    // Of several links to one folder, one is enough.
                    let new = !link || path.canonicalize().is_ok_and(|real| linked.insert(real));
                    if depth < DEEPEST && new {
                        folders.push((path, format!("{inside}/"), depth + 1));
                    }
                } else if meta.is_file() && wanted(Path::new(&inside)) {
                    found.push(inside);
                }
            }
        }
        Self::of(found)
    }

    fn of(mut found: Vec<String>) -> Self {
        found.sort();
        let files: Vec<Name> = found.iter().map(|text| Name::of(text)).collect();
        let mut by_stem: HashMap<String, Vec<usize>> = HashMap::new();
        for (at, name) in files.iter().enumerate() {
            by_stem.entry(name.stem().to_owned()).or_default().push(at);
        }
        Self { files, by_stem }
    }

    /// Looks up several names in a folder, each in its possible forms, the likeliest first. A file that one name
    /// matches exactly is not given to another name. Files are listed only where a name has no exact match.
    pub(crate) fn look_up(root: &Path, names: &[Vec<String>], wanted: impl Fn(&Path) -> bool) -> Vec<NameMatch> {
        let exact = |forms: &Vec<String>| forms.iter().find(|form| is_there(root, form)).cloned();
        let exact: Vec<Option<String>> = names.iter().map(exact).collect();
        if exact.iter().all(Option::is_some) {
            return exact.into_iter().flatten().map(NameMatch::AsNamed).collect();
        }
        Self::below(root, wanted).match_all(names, exact)
    }

    /// Looks up names among other names instead of files.
    pub(crate) fn among(others: &[&str], names: &[String]) -> Vec<NameMatch> {
        let known: HashSet<&str> = others.iter().copied().collect();
        let exact = names.iter().map(|name| known.contains(name.as_str()).then(|| name.clone())).collect();
        let forms: Vec<Vec<String>> = names.iter().map(|name| vec![name.clone()]).collect();
        Self::of(known.into_iter().map(str::to_owned).collect()).match_all(&forms, exact)
    }

    fn match_all(&self, names: &[Vec<String>], exact: Vec<Option<String>>) -> Vec<NameMatch> {
        let taken: HashSet<String> = exact.iter().flatten().map(|name| Name::of(name).parts.join("/")).collect();
        let one = |(forms, exact): (&Vec<String>, Option<String>)| match exact {
            Some(name) => NameMatch::AsNamed(name),
            None => self.nearly(forms, &taken),
        };
        let mut found: Vec<NameMatch> = names.iter().zip(exact).map(one).collect();
        let mut times: HashMap<String, usize> = HashMap::new();
        for found in &found {
            if let NameMatch::Otherwise(file, _) = found {
                *times.entry(file.clone()).or_default() += 1;
            }
        }
        for found in &mut found {
            if let NameMatch::Otherwise(file, _) = found
                && times.get(file).is_some_and(|n| *n > 1)
            {
                *found = NameMatch::Unclear(vec![std::mem::take(file)]);
            }
        }
        found
    }

    fn nearly(&self, forms: &[String], taken: &HashSet<String>) -> NameMatch {
        let mut best: Vec<(Rank, usize, Differences)> = Vec::new();
        for name in forms.iter().map(|form| Name::of(form)) {
            for &at in self.by_stem.get(name.stem()).map_or(&[][..], Vec::as_slice) {
                let Some(file) = self.files.get(at).filter(|file| !taken.contains(&file.parts.join("/"))) else {
                    continue;
                };
                let Some((rank, differences)) = name.compare(file) else { continue };
                match best.first() {
                    Some((least, ..)) if *least < rank => continue,
                    Some((least, ..)) if *least > rank => best.clear(),
                    _ => {}
                }
                if best.iter().all(|(_, other, _)| *other != at) {
                    best.push((rank, at, differences));
                }
            }
        }
        let text = |at: usize| self.files.get(at).map(|file| file.text.clone()).unwrap_or_default();
        match best.as_slice() {
            [] => NameMatch::Missing,
            [(_, at, differences)] => NameMatch::Otherwise(text(*at), *differences),
            several => NameMatch::Unclear(several.iter().map(|(_, at, _)| text(*at)).collect()),
        }
    }

    /// The file whose name needs the fewest changes to become `name`, among files not found for another name.
    pub(crate) fn nearest(&self, name: &str, taken: &[NameMatch]) -> Option<&str> {
        let taken: HashSet<&str> = taken.iter().filter_map(NameMatch::file).collect();
        let wanted = Name::of(name);
        // Folders count little: the last part identifies a name.
        let last = |name: &Name| name.parts.last().map(|part| part.to_lowercase()).unwrap_or_default();
        let (whole, part) = (wanted.parts.join("/").to_lowercase(), last(&wanted));
        let far = |file: &Name| {
            let text = file.text.to_lowercase();
            (strsim::osa_distance(&part, &last(file)), strsim::osa_distance(&whole, &text))
        };
        let free = self.files.iter().filter(|file| !taken.contains(file.text.as_str()));
        free.min_by_key(|file| far(file)).map(|file| file.text.as_str())
    }
}

/// Whether a folder has a file of exactly this name inside.
pub(super) fn is_there(root: &Path, name: &str) -> bool {
    !name.is_empty() && stays_inside(name) && root.join(name).is_file()
}

impl Name {
    fn of(text: &str) -> Self {
        let slashes = text.replace('\\', "/");
        let drive = slashes.as_bytes().get(1) == Some(&b':') && slashes.as_bytes()[0].is_ascii_alphabetic();
        let (mut outside, mut parts) = (slashes.starts_with('/') || drive, Vec::<String>::new());
        for part in slashes.split('/').skip(usize::from(drive)) {
            match part {
                "" | "." => {}
                // `..` out of the folder leads to parts that the folder may have.
                ".." => outside |= parts.pop().is_none(),
                _ => parts.push(part.nfc().collect::<String>()),
            }
        }
        let mut folded: Vec<String> = parts.iter().map(|part| part.to_lowercase()).collect();
        let mut extension = String::new();
        // Masks have names such as `a.jpg.png`.
        while let Some(last) = folded.last_mut()
            && let Some((stem, word)) = last.rsplit_once('.')
            && !stem.is_empty()
            && PICTURES.contains(&word)
        {
            extension = if extension.is_empty() { word.to_owned() } else { format!("{word}.{extension}") };
            *last = stem.to_owned();
        }
        let separators = text.nfc().collect::<String>() != parts.join("/");
        let composed = is_nfc(slashes.rsplit('/').next().unwrap_or_default());
        Self { text: text.to_owned(), parts, folded, extension, outside, separators, composed }
    }

    fn stem(&self) -> &str {
        self.folded.last().map_or("", String::as_str)
    }

    /// Similarity to the name of a file with the same stem; `None` where the names do not match.
    fn compare(&self, file: &Self) -> Option<(Rank, Differences)> {
        let shared = self.folded.iter().rev().zip(file.folded.iter().rev()).take_while(|(a, b)| a == b).count();
        let (own, others) = (self.folded.len(), file.folded.len());
        let class = match shared {
            0 => return None,
            _ if shared == own && shared == others => 0,
            _ if shared == own || shared == others => 1,
            // Other folders may be other cameras. Only for paths that lead out of the folder is the last part enough.
            _ if self.outside => 2,
            _ => return None,
        };
        let extension = self.extension != file.extension;
        let tail =
            |name: &Self| name.parts.get(name.parts.len() - shared..).map(<[String]>::to_vec).unwrap_or_default();
        let case = match (tail(self), tail(file)) {
            (a, b) if extension => {
                let bare = |parts: Vec<String>, name: &Self| {
                    let mut text = parts.join("/");
                    let dotted = if name.extension.is_empty() { 0 } else { name.extension.len() + 1 };
                    text.truncate(text.len().saturating_sub(dotted));
                    text
                };
                bare(a, self) != bare(b, file)
            }
            (a, b) => a != b,
        };
        let separators = self.separators || file.separators;
        let known = separators || case || extension || class > 0 || self.outside;
        let differences = Differences {
            separators,
            // The names are equal in the composed form.
            unicode: self.composed != file.composed || !known,
            case,
            extension,
            prefix: class > 0,
            outside: self.outside,
        };
        Some(((class, std::cmp::Reverse(shared), extension, case), differences))
    }
}

/// Counts of names that differ from those of their files, by kind: a line for the user.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Renamed {
    /// Counts by kind of difference.
    pub kinds: Vec<(Differences, usize)>,
    /// The first such name, and the name of its file.
    pub first: (String, String),
}

impl Renamed {
    /// From pairs of a name and its file; `None` where no name differs.
    pub(crate) fn of<'a>(found: impl IntoIterator<Item = (&'a str, &'a NameMatch)>) -> Option<Self> {
        let (mut kinds, mut first) = (BTreeMap::<Differences, usize>::new(), None);
        for (name, found) in found {
            if let NameMatch::Otherwise(file, differences) = found {
                *kinds.entry(*differences).or_default() += 1;
                first = first.or_else(|| Some((name.to_owned(), file.clone())));
            }
        }
        let mut kinds: Vec<(Differences, usize)> = kinds.into_iter().collect();
        kinds.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        first.map(|first| Self { kinds, first })
    }

    /// Number of names that differ.
    pub fn count(&self) -> usize {
        self.kinds.iter().map(|(_, count)| count).sum()
    }
}

impl fmt::Display for Renamed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kinds: Vec<String> = self.kinds.iter().map(|(kind, count)| format!("{count} by {kind}")).collect();
        write!(f, "{} ('{}' is '{}')", kinds.join(", "), self.first.0, self.first.1)
    }
}

/// What to say about a missing photograph, worded to follow a sentence. `found` is the result for it, and `all` the
/// results for all photographs.
pub(crate) fn instead(
    name: &str,
    found: &NameMatch,
    all: &[NameMatch],
    root: &Path,
    wanted: impl Fn(&Path) -> bool,
) -> String {
    let outside = match leads_out(name) {
        true => ", which leads out of the folder of photographs and is not followed",
        false => "",
    };
    format!("{outside}{}", in_place(name, found, all, root, wanted))
}

/// What to say about another missing path in a file of the dataset, worded to follow a sentence.
pub(crate) fn missing(path: &str, found: &NameMatch, root: &Path, wanted: impl Fn(&Path) -> bool) -> String {
    let why = match leads_out(path) {
        true => ", which leads out of the dataset and is not followed",
        false => ", which is not there",
    };
    format!("{why}{}", in_place(path, found, &[], root, wanted))
}

fn in_place(name: &str, found: &NameMatch, all: &[NameMatch], root: &Path, wanted: impl Fn(&Path) -> bool) -> String {
    if let NameMatch::Unclear(files) = found {
        let files: Vec<String> = files.iter().map(|file| format!("'{file}'")).collect();
        return match files.as_slice() {
            [one] => format!("; {one} is there, and other names could mean it too"),
            several => format!("; {} are there, and it could be any of them", several.join(" and ")),
        };
    }
    match Names::below(root, wanted).nearest(name, all) {
        Some(nearest) => format!("; the nearest name that is there is '{nearest}'"),
        None => String::new(),
    }
}

/// Whether a path leads out of its folder, in the notation of any system.
pub(crate) fn leads_out(name: &str) -> bool {
    Name::of(name).outside
}

/// A name for files made from a photograph: the part of its path that stays inside a folder.
pub(crate) fn made_safe(name: &str) -> String {
    let name = Name::of(name);
    let plain = |part: &&String| Path::new(part).components().all(|c| matches!(c, Component::Normal(_)));
    let parts: Vec<&str> = name.parts.iter().filter(plain).map(String::as_str).collect();
    parts.join("/")
}

/// Whether a name stays inside its folder.
pub(super) fn stays_inside(name: &str) -> bool {
    Path::new(name).components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir))
}

/// Whether a file or folder is hidden. macOS writes `._a.jpg` beside each file on a foreign disk.
pub(super) fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(files: &[&str], names: &[&str]) -> Vec<NameMatch> {
        let names: Vec<Vec<String>> = names.iter().map(|name| vec![(*name).to_owned()]).collect();
        let exact =
            names.iter().map(|forms| forms.iter().find(|name| files.contains(&name.as_str())).cloned()).collect();
        Names::of(files.iter().map(|file| (*file).to_owned()).collect()).match_all(&names, exact)
    }

    fn by(files: &[&str], name: &str) -> Option<(String, String)> {
        match found(files, &[name]).remove(0) {
            NameMatch::Otherwise(file, differences) => Some((file, differences.to_string())),
            _ => None,
        }
    }

    #[test]
    fn names_that_differ_by_one_thing_are_found_by_it() {
        for (file, name, difference) in [
            ("a/b.jpg", "A/b.jpg", "letter case"),
            ("b.JPG", "b.jpg", "letter case and extension"),
            ("b.png", "b.jpg", "extension"),
            ("b.v2.png", "b.v2", "extension"),
            ("a/b.jpg", "a\\b.jpg", "separators"),
            ("a/b.jpg", "c/../a/b.jpg", "separators"),
            ("b.jpg", "images/b.jpg", "folders before the name"),
            ("c/b.jpg", "b.jpg", "folders before the name"),
            ("c/b.jpg", ".\\b.jpg", "separators and folders before the name"),
            ("u\u{308}.jpg", "\u{fc}.jpg", "Unicode form"),
            ("\u{fc}.jpg", "u\u{308}.jpg", "Unicode form"),
            ("c/b.jpg", "../b.jpg", "a path that leads out of the dataset, which is not followed"),
            ("c/b.jpg", "/home/someone/d/b.jpg", "a path that leads out of the dataset, which is not followed"),
            ("c/b.jpg", "C:\\pictures\\c\\b.jpg", "a path that leads out of the dataset, which is not followed"),
        ] {
            let expected = match difference {
                "letter case and extension" => "letter case".to_owned(),
                other => other.to_owned(),
            };
            assert_eq!(by(&[file, "other.jpg"], name), Some((file.to_owned(), expected)), "{name}");
        }
    }

    #[test]
    fn the_most_alike_is_taken_and_a_tie_is_unclear() {
        assert_eq!(by(&["B.jpg", "b.png", "x/b.jpg"], "b.jpg").map(|f| f.0).as_deref(), Some("B.jpg"));
        assert_eq!(by(&["b.png", "x/b.jpg"], "b.jpg").map(|f| f.0).as_deref(), Some("b.png"));
        assert_eq!(by(&["x/b.jpg", "y/b.jpg"], "/p/y/b.jpg").map(|f| f.0).as_deref(), Some("y/b.jpg"));
        let two = |a: &str, b: &str| NameMatch::Unclear(vec![a.to_owned(), b.to_owned()]);
        assert_eq!(found(&["x/b.jpg", "y/b.jpg"], &["b.jpg"]), [two("x/b.jpg", "y/b.jpg")]);
        assert_eq!(found(&["b.jpeg", "b.png"], &["b.jpg"]), [two("b.jpeg", "b.png")]);
    }

    #[test]
    fn a_file_belongs_to_one_name() {
        // One name is exact; one file has two names; one file is of another camera.
        let both = found(&["b.jpg"], &["b.jpg", "b.png"]);
        assert_eq!(both, [NameMatch::AsNamed("b.jpg".to_owned()), NameMatch::Missing]);
        let unclear = NameMatch::Unclear(vec!["b.JPG".to_owned()]);
        assert_eq!(found(&["b.JPG"], &["b.jpg", "B.jpg"]), [unclear.clone(), unclear]);
        assert_eq!(found(&["right/b.jpg"], &["left/b.jpg"]), [NameMatch::Missing]);
    }

    #[test]
    fn the_nearest_name_is_the_one_with_the_fewest_changes() {
        let names = Names::of(["far.jpg", "IMG_0012.jpg", "x/IMG_0013.jpg"].map(str::to_owned).to_vec());
        assert_eq!(names.nearest("images/img_0113.jpg", &[]), Some("x/IMG_0013.jpg"));
        assert_eq!(Names::of(Vec::new()).nearest("a", &[]), None);
    }

    #[test]
    fn names_of_results_stay_inside() {
        for (name, safe) in
            [("/a/b.jpg", "a/b.jpg"), ("..\\b.jpg", "b.jpg"), ("C:\\x\\b.jpg", "x/b.jpg"), ("../../..", "")]
        {
            assert_eq!(made_safe(name), safe);
            assert!(leads_out(name));
        }
        assert!(!leads_out("a/./b.jpg") && !leads_out("a/../b.jpg"));
    }
}
