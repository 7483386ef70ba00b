//! The lists of frames by role in a `transforms.json`.

use psrgs_vk::dataset::{Dataset, LoadOptions, Role, Split, Warning};
use serde_json::json;

use crate::colmap_folder::Folder;
use crate::formats::{nerfstudio, transforms, write_json};

const TEN: [&str; 10] = ["0.png", "1.png", "2.png", "3.png", "4.png", "5.png", "6.png", "7.png", "8.png", "9.png"];

/// Training frames, held-out frames and warnings; frames by the digits of their names.
fn split(lists: &[(&str, &[&str])], split: Split) -> (String, String, Vec<Warning>) {
    let folder = Folder::ring(&TEN, [0.0; 3]);
    let root = nerfstudio(&folder, false);
    let mut value = transforms(&folder);
    for (key, names) in lists {
        value[key] = json!(names);
    }
    write_json(&root.path().join("transforms.json"), &value);
    let dataset = Dataset::load(root.path(), &LoadOptions { split, ..LoadOptions::default() }).expect("loads");
    let of = |role| dataset.views_of(role).map(|(_, view)| &view.name[..1]).collect::<String>();
    (of(Role::Train), of(Role::HeldOut), dataset.warnings)
}

#[test]
fn the_lists_of_transforms_json_are_the_split() {
    let train =
        ["./images/0.png", "./images/1.png", "./images/2.png", "./images/3.png", "./images/4.png", "./images/5.png"];
    let (val, test) = (["./images/6.png", "./images/7.png"], ["./images/8.png", "./images/9.png"]);
    let all: &[(&str, &[&str])] = &[("train_filenames", &train), ("val_filenames", &val), ("test_filenames", &test)];
    let told = |a: &str, b: &str| (a.to_owned(), b.to_owned(), Vec::new());
    assert_eq!(split(all, Split::Test), told("012345", "89"));
    assert_eq!(split(all, Split::Val), told("012345", "67"));
    assert_eq!(split(all, Split::None), told("012345", ""));
    // Converters write equal lists for validation and test.
    let same: &[(&str, &[&str])] = &[("train_filenames", &train), ("val_filenames", &test), ("test_filenames", &test)];
    let (trained, held_out, warnings) = split(same, Split::Val);
    assert_eq!((trained.as_str(), held_out.as_str()), ("012345", "89"));
    assert!(matches!(warnings.as_slice(), [Warning::SplitLists { used: true, in_none: 2, .. }]), "{warnings:?}");
    // Without a list of training frames, the rest is trained on.
    assert_eq!(split(&[("test_filenames", &test)], Split::Test), told("01234567", "89"));
    // Names may differ from those of frames as file names may.
    assert_eq!(split(&[("test_filenames", &["images/8.png", "IMAGES\\9.PNG"])], Split::Test), told("01234567", "89"));
    assert_eq!(split(&[("test_filenames", &[])], Split::Test), told("12345679", "08"));
}

#[test]
fn lists_that_do_not_fit_the_frames_are_told() {
    let (_, held_out, warnings) = split(&[("test_filenames", &["8.png", "other/77.png"])], Split::Test);
    assert_eq!(held_out, "8");
    let [Warning::SplitLists { used: true, unknown: 1, first: Some(first), .. }] = warnings.as_slice() else {
        panic!("{warnings:?}")
    };
    assert!(first.contains("other/77.png") && first.contains("test_filenames"), "{first}");
    let (train, held_out, warnings) =
        split(&[("train_filenames", &["1.png", "2.png", "3.png"]), ("test_filenames", &["3.png"])], Split::Test);
    assert_eq!((train.as_str(), held_out.as_str()), ("12", "3"));
    assert!(matches!(warnings.as_slice(), [Warning::SplitLists { in_both: 1, in_none: 7, .. }]), "{warnings:?}");
    // No frame would be left to train on: the lists are ignored.
    let (_, held_out, warnings) = split(&[("train_filenames", &["x.png"])], Split::Test);
    assert_eq!(held_out, "08");
    assert!(matches!(warnings.as_slice(), [Warning::SplitLists { used: false, .. }]), "{warnings:?}");
    assert!(warnings[0].to_string().contains("the lists are not used"), "{}", warnings[0]);
}
