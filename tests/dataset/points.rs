//! Reconstructed points: their files, and points without useful colours.

use std::fs;
use std::path::Path;

use image::{Rgb, RgbImage};
use psrgs_vk::dataset::{Dataset, NoColours, Role, Warning};
use psrgs_vk::format::ply::Cloud;
use psrgs_vk::scene::init::SH_C0;
use psrgs_vk::stereo::Observations;
use psrgs_vk::train::{Input, Settings, prepare};

use super::colmap_folder::{Folder, ImageRow, PointRow};
use super::formats::transforms;
use super::{NAMES, load};

/// A ring of cameras with points all over their photographs.
fn ring(names: &[&str]) -> Folder {
    let mut folder = Folder::ring(names, [0.0; 3]);
    let one = folder.points[0].clone();
    let point = |k: u8| {
        let (x, y) = (f64::from(k % 8) - 3.5, f64::from(k / 8) - 3.5);
        PointRow {
            id: u64::from(k),
            position: [0.8 * x, 0.34 * y, 0.03 * x * y],
            colour: [4 * k, 255 - k, 128],
            ..one.clone()
        }
    };
    folder.points = (0..64).map(point).collect();
    folder
}

/// Photographs of one colour each.
fn write_plain(folder: &Folder, root: &Path, colour: impl Fn(usize, &ImageRow) -> [u8; 3]) {
    for (i, image) in folder.images.iter().enumerate() {
        let picture = RgbImage::from_pixel(24, 16, Rgb(colour(i, image)));
        picture.save(root.join("images").join(&image.name)).expect("a photograph");
    }
}

fn input(dataset: &Dataset, settings: &Settings) -> Input {
    prepare::input(dataset, settings).expect("an input")
}

/// The colours of the first splats.
fn shown(input: &Input) -> Vec<[u8; 3]> {
    let colour = |sh: &[f32]| [0, 1, 2].map(|c| (255.0 * (0.5 + SH_C0 * f64::from(sh[c]))).round() as u8);
    input.initial.sh[0].chunks_exact(12).map(colour).collect()
}

#[test]
fn points_of_one_colour_take_the_colours_of_the_photographs() {
    let mut folder = ring(&NAMES);
    for colour in [[0; 3], [255; 3], [10, 20, 30]] {
        folder.points.iter_mut().for_each(|point| point.colour = colour);
        let root = folder.dataset(false);
        // `a` is held out, so training must not see its colour.
        write_plain(&folder, root.path(), |_, image| if image.name == "a.png" { [9; 3] } else { [200, 100, 50] });
        let dataset = load(root.path()).expect("loads");
        let told = dataset.warnings.iter().filter(|warning| matches!(warning, Warning::PointsWithoutColours(_)));
        assert_eq!(told.count(), 1, "{:?}", dataset.warnings);
        let input = input(&dataset, &Settings::default());
        assert_eq!(shown(&input), vec![[200, 100, 50]; dataset.points.len()], "{colour:?}");
        let coloured = input.optional.coloured.expect("taken");
        assert_eq!((coloured.seen, coloured.points), (64, 64));
        assert_eq!(coloured.colourless.why, NoColours::OneColour(colour));
    }
}

#[test]
fn points_with_colours_of_their_own_keep_them() {
    let folder = ring(&NAMES);
    let root = folder.dataset(false);
    let dataset = load(root.path()).expect("loads");
    assert_eq!(dataset.colourless, None);
    let input = input(&dataset, &Settings::default());
    assert_eq!(input.initial, dataset.first_gaussians().expect("points"));
    assert_eq!(input.optional.coloured, None);
}

#[test]
fn colours_come_from_the_photographs_that_observe_a_point() {
    let mut folder = ring(&["a.png", "b.png", "c.png", "d.png", "e.png"]);
    for (k, point) in folder.points.iter_mut().enumerate() {
        // Observed by the second image and the last in turn, though the point lies in the frame of every image.
        (point.colour, point.track) = ([0; 3], vec![(if k % 2 == 0 { 2 } else { 5 }, 0)]);
    }
    let root = folder.dataset(false);
    write_plain(&folder, root.path(), |i, _| [i as u8 * 50, 7, 7]);
    let dataset = load(root.path()).expect("loads");
    let want: Vec<[u8; 3]> = (0..64).map(|k| [if k % 2 == 0 { 50 } else { 200 }, 7, 7]).collect();
    assert_eq!(shown(&input(&dataset, &Settings::default())), want);
}

#[test]
fn an_init_cloud_without_colours_takes_those_of_photographs() {
    let folder = ring(&NAMES);
    let root = folder.dataset(false);
    write_plain(&folder, root.path(), |_, _| [200, 100, 50]);
    let dataset = load(root.path()).expect("loads");
    let file = root.path().join("cloud.ply");
    // The last point is behind all cameras.
    let positions = vec![[0.1, 0.2, 0.0], [0.3, -0.2, 0.1], [0.0, 0.0, 50.0]];
    Cloud { positions, ..Cloud::default() }.write(&file).expect("written");
    let mut settings = Settings::default();
    settings.run.init = Some(file);
    let input = input(&dataset, &settings);
    assert_eq!(shown(&input), vec![[200, 100, 50]; 3]);
    let coloured = input.optional.coloured.expect("taken");
    assert_eq!((coloured.seen, coloured.points, coloured.of_dataset), (2, 3, false));
    assert!(
        coloured.colourless.to_string().contains("cloud.ply: the file holds no colours"),
        "{}",
        coloured.colourless
    );
}

#[test]
fn colours_in_text_may_be_floats_or_words_of_16_bits() {
    let folder = ring(&NAMES);
    let root = folder.dataset(true);
    let want = load(root.path()).expect("loads");
    let write = |factor: f64, digits: usize| {
        let row = |p: &PointRow| {
            let ([x, y, z], [r, g, b]) = (p.position, p.colour.map(|c| f64::from(c) * factor));
            format!("{} {x} {y} {z} {r:.digits$} {g:.digits$} {b:.digits$} 0.5\n", p.id)
        };
        let text: String = folder.points.iter().map(row).collect();
        fs::write(root.path().join("sparse/0/points3D.txt"), text).expect("written");
    };
    for (factor, digits) in [(1.0, 0), (1.0, 1), (1.0 / 255.0, 4), (257.0, 0)] {
        write(factor, digits);
        let dataset = load(root.path()).expect("loads");
        let colours = |dataset: &Dataset| dataset.points.iter().map(|p| p.colour).collect::<Vec<_>>();
        assert_eq!(colours(&dataset), colours(&want), "{factor}");
    }
    write(-3.0, 0);
    let told: Vec<String> = load(root.path()).expect("loads").warnings.iter().map(ToString::to_string).collect();
    assert!(told.iter().any(|line| line.contains("no colours that can be read")), "{told:?}");
}

#[test]
fn points3d_ply_alone_is_the_cloud_of_a_colmap_model() {
    let folder = ring(&NAMES);
    for text in [false, true] {
        let root = folder.dataset(text);
        let sparse = root.path().join("sparse/0");
        let whole = load(root.path()).expect("loads");
        let kept = if text { "points3D.txt" } else { "points3D.bin" };
        let cloud = Cloud {
            positions: vec![[0.0, 0.5, 0.25], [1.0, 2.0, 0.5]],
            colours: vec![[1, 2, 3], [4, 5, 6]],
            ..Cloud::default()
        };
        cloud.write(&sparse.join("points3D.ply")).expect("written");
        assert_eq!(load(root.path()).expect("loads").points, whole.points, "beside {kept} it is not read");
        fs::remove_file(sparse.join(kept)).expect("removed");
        let dataset = load(root.path()).expect("loads");
        let read: Vec<_> = dataset.points.iter().map(|point| (point.position, point.colour)).collect();
        assert_eq!(read, [([0.0, 0.5, 0.25], [1, 2, 3]), ([1.0, 2.0, 0.5], [4, 5, 6])]);
        assert!(
            dataset.tracks.is_empty() && dataset.colourless.is_none() && dataset.warnings.is_empty(),
            "{:?}",
            dataset.warnings
        );
    }
}

/// Names of photographs.
fn names(count: usize) -> Vec<String> {
    (0..count).map(|i| format!("{i:02}.png")).collect()
}

#[test]
fn points_of_no_use_are_told_and_training_begins_as_without_any() {
    let names = names(9);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let whole = ring(&names);
    let at = |position: [f64; 3], id: u64| PointRow { id, position, track: vec![], ..whole.points[0].clone() };
    let eye = |i: &ImageRow| [-i.translation[0], i.translation[1], i.translation[2]];
    let few = |count: usize| whole.points.iter().step_by(64 / count).take(count).cloned().collect::<Vec<_>>();
    let mut none = whole.clone();
    none.points.clear();
    let none = load(none.dataset(false).path()).expect("loads");
    let first = |dataset: &Dataset| prepare::first(dataset, &Settings::default()).expect("a start").splats;
    for (what, points) in [
        ("one", few(1)),
        ("three", few(3)),
        ("ten", few(10)),
        ("the places of cameras", (0..).zip(&whole.images).map(|(k, i)| at(eye(i), k)).collect()),
        (
            "all behind the cameras",
            whole.points.iter().map(|p| at([p.position[0] + 200.0, p.position[1], 30.0], p.id)).collect(),
        ),
        ("all at one place", (0..500).map(|k| at([0.3, 0.2, 0.0], k)).collect()),
        (
            "far beside the pictures",
            whole.points.iter().map(|p| at([p.position[0] + 90.0, p.position[1], 0.0], p.id)).collect(),
        ),
    ] {
        let root = Folder { points, ..whole.clone() }.dataset(false);
        let dataset = load(root.path()).expect("loads");
        let useless = dataset.useless.as_ref().unwrap_or_else(|| panic!("{what}: taken for useful"));
        assert_eq!((useless.served, useless.views, useless.kept.len()), (0, 7, 0), "{what}");
        assert_eq!(first(&dataset), first(&none), "{what}");
        let told = dataset.problems(&dataset.sights()).join("\n");
        assert!(told.contains("points3D.bin: the points are of little use: of 7 photographs"), "{what}: {told}");
        assert!(!told.contains("pose"), "{what}: {told}");
        // Stereo searches the depths that it would search without points.
        let chosen: Vec<usize> = dataset.views_of(Role::Train).map(|(i, _)| i).collect();
        assert_eq!(Observations::of(&dataset, &chosen, 3), Observations::of(&none, &chosen, 3), "{what}");
    }
}

#[test]
fn points_that_serve_a_part_of_the_photographs_stay() {
    let names = names(12);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let whole = ring(&names);
    let dataset = load(whole.dataset(false).path()).expect("loads");
    assert_eq!((&dataset.useless, dataset.problems(&dataset.sights())), (&None, vec![]), "all are served");
    // Of ten training photographs (0 and 8 are held out) some see no point. One in four that sees points is enough.
    for (away, useful) in [(7, true), (8, false)] {
        let mut folder = whole.clone();
        let on = folder.images.iter_mut().enumerate().filter(|(i, _)| i % 8 != 0).map(|(_, image)| image);
        for (k, image) in on.take(away).enumerate() {
            image.translation[0] -= 20.0 + 0.5 * k as f64;
        }
        let dataset = load(folder.dataset(false).path()).expect("loads");
        assert_eq!(dataset.useless.is_none(), useful, "{away} are away: {:?}", dataset.useless);
        assert_eq!(dataset.usable_points(), dataset.points, "two see all of them");
        let begun = prepare::initial(&dataset, &Settings::default()).expect("a start").len();
        assert_eq!(begun == 64, useful, "{begun} splats: random ones are added to the points");
    }
}

/// Clouds of datasets in both formats and of `--init`: colours as floats, as words, under other names, and missing.
#[test]
fn colours_of_clouds_are_read_wherever_a_cloud_is_read() {
    let mut folder = ring(&NAMES);
    folder.points.truncate(2);
    let (of_colmap, of_frames) = (folder.dataset(false), folder.dataset(false));
    let sparse = of_colmap.path().join("sparse/0");
    fs::remove_file(sparse.join("points3D.bin")).expect("removed");
    fs::remove_dir_all(of_frames.path().join("sparse")).expect("removed");
    fs::write(of_frames.path().join("transforms.json"), transforms(&folder).to_string()).expect("written");
    write_plain(&folder, of_colmap.path(), |_, _| [200, 100, 50]);
    write_plain(&folder, of_frames.path(), |_, _| [200, 100, 50]);
    let files =
        [sparse.join("points3D.ply"), of_frames.path().join("sparse_pc.ply"), of_colmap.path().join("init.ply")];
    let written = |names: &str, kind: &str, rows: [&str; 2]| {
        let names: String = names.split_whitespace().map(|name| format!("property {kind} {name}\n")).collect();
        let row = |i: usize| {
            let [x, y, z] = folder.points[i].position;
            format!("{x} {y} {z} {}\n", rows[i])
        };
        let head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\n";
        let text = format!("{head}{names}end_header\n{}{}", row(0), row(1));
        files.iter().for_each(|file| fs::write(file, &text).expect("written"));
    };
    let own = vec![[0, 51, 255], [255, 102, 0]];
    for (names, kind, rows, want) in [
        ("red green blue", "uchar", ["0 51 255", "255 102 0"], &own),
        ("red green blue", "float", ["0 0.2 1", "1 0.4 0"], &own),
        ("diffuse_red diffuse_green diffuse_blue", "ushort", ["0 13107 65535", "65535 26214 0"], &own),
        ("r g b", "double", ["0 0.2 1", "1 0.4 0"], &own),
        ("intensity", "float", ["0.5", "0.25"], &vec![[200, 100, 50]; 2]),
    ] {
        written(names, kind, rows);
        for (root, init) in [(&of_colmap, None), (&of_frames, None), (&of_colmap, Some(files[2].clone()))] {
            let place = if init.is_some() { "--init" } else { root.path().to_str().expect("a name") };
            let dataset = load(root.path()).expect("loads");
            let mut settings = Settings::default();
            settings.run.init = init;
            if settings.run.init.is_some() {
                assert_eq!(&shown(&input(&dataset, &settings)), want, "{names} of {kind} in {place}");
            }
            let own = dataset.points.iter().map(|point| point.colour).collect::<Vec<_>>();
            assert_eq!(dataset.colourless.is_none(), names != "intensity", "{place}");
            assert!(dataset.colourless.is_some() || &own == want, "{names} of {kind} in {place}: {own:?}");
        }
    }
}
