//! Models in unusual places, and errors where there is no model.

use std::fs;
use std::path::Path;

use psrgs_vk::dataset::{Dataset, Format, LoadOptions, Warning};

use crate::colmap_folder::Folder;
use crate::formats::nerfstudio;
use crate::{NAMES, load};

fn move_into(from: &Path, to: &Path) {
    fs::create_dir_all(to).expect("folder");
    for entry in fs::read_dir(from).expect("folder") {
        let path = entry.expect("entry").path();
        fs::rename(&path, to.join(path.file_name().expect("name"))).expect("moved");
    }
    fs::remove_dir_all(from).expect("removed");
}

/// A dataset with its model in the folder `model` and its photographs in the folder `photographs`.
fn laid_out(model: &str, photographs: &str) -> tempfile::TempDir {
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    let sparse = root.path().join("sparse");
    move_into(&sparse.join("0"), &root.path().join("kept"));
    fs::remove_dir_all(&sparse).expect("removed");
    move_into(&root.path().join("kept"), &root.path().join(model));
    if photographs != "images" {
        move_into(&root.path().join("images"), &root.path().join(photographs));
    }
    root
}

#[test]
fn models_in_other_places_are_found() {
    for (model, photographs) in [
        ("sparse/aligned", "images"),
        (".", "images"),
        (".", "."),
        ("colmap/sparse/0", "images"),
        ("colmap/sparse", "images"),
        ("colmap", "images"),
        ("distorted/sparse/0", "input"),
        ("distorted/sparse/0", "images"),
    ] {
        let root = laid_out(model, photographs);
        let dataset = load(root.path()).unwrap_or_else(|error| panic!("{model}, {photographs}: {error}"));
        assert_eq!((dataset.format, dataset.views.len(), dataset.points.len()), (Format::Colmap, 3, 12), "{model}");
        assert!(dataset.warnings.is_empty(), "{model}: {:?}", dataset.warnings);
        assert!(dataset.views[0].path.ends_with(format!("{photographs}/a.png").trim_start_matches("./")), "{model}");
        let asked = LoadOptions { format: Some(Format::Colmap), ..LoadOptions::default() };
        assert_eq!(Dataset::load(root.path(), &asked).expect("asked for").views.len(), 3);
    }
}

#[test]
fn originals_of_a_conversion_go_with_the_original_model() {
    // convert.py leaves undistorted photographs in images/ and their model in sparse/0, beside the originals.
    let root = laid_out("distorted/sparse/0", "input");
    Folder::ring(&NAMES, [0.0; 3]).write_photographs(&root.path().join("images"));
    let dataset = load(root.path()).expect("the originals");
    assert!(dataset.views[0].path.ends_with("input/a.png"), "{}", dataset.views[0].path.display());
    let whole = Folder::ring(&NAMES, [0.0; 3]);
    whole.write(root.path(), &whole.binary());
    let dataset = load(root.path()).expect("the result");
    assert!(dataset.views[0].path.ends_with("images/a.png") && dataset.warnings.is_empty());
}

#[test]
fn of_models_in_two_places_the_one_that_is_read_is_told() {
    let whole = Folder::ring(&NAMES, [0.0; 3]);
    let mut part = whole.clone();
    part.images.truncate(2);
    // The usual place wins over all others.
    let root = laid_out("sparse/aligned", "images");
    part.write(root.path(), &part.binary());
    let dataset = load(root.path()).expect("loads");
    assert_eq!(dataset.views.len(), 2);
    let warning = Warning::OtherPlaces { used: "sparse/0".to_owned(), others: vec!["sparse/aligned".to_owned()] };
    assert!(dataset.warnings.contains(&warning), "{:?}", dataset.warnings);
    // Otherwise the model with the most images.
    fs::rename(root.path().join("sparse/0"), root.path().join("sparse/a-part")).expect("moved");
    let dataset = load(root.path()).expect("loads");
    let warning = Warning::OtherPlaces { used: "sparse/aligned".to_owned(), others: vec!["sparse/a-part".to_owned()] };
    assert_eq!((dataset.views.len(), dataset.warnings.as_slice()), (3, &[warning][..]));
    // transforms.json wins over a model of COLMAP beside it.
    let root = nerfstudio(&whole, false);
    whole.binary().iter().for_each(|(name, bytes)| fs::write(root.path().join(name), bytes).expect("written"));
    let dataset = load(root.path()).expect("loads");
    let several = Warning::SeveralFormats { used: Format::Nerfstudio, others: vec![Format::Colmap] };
    assert_eq!((dataset.format, dataset.warnings.as_slice()), (Format::Nerfstudio, &[several][..]));
    let asked = LoadOptions { format: Some(Format::Colmap), ..LoadOptions::default() };
    assert_eq!(Dataset::load(root.path(), &asked).expect("asked for").format, Format::Colmap);
    // nerfstudio's own folder colmap/ is no second model.
    let root = nerfstudio(&whole, false);
    fs::create_dir_all(root.path().join("colmap/sparse/0")).expect("folder");
    for (name, bytes) in whole.binary() {
        fs::write(root.path().join("colmap/sparse/0").join(name), bytes).expect("written");
    }
    assert!(load(root.path()).expect("loads").warnings.is_empty());
}

#[test]
fn the_folder_of_a_model_is_not_a_dataset_of_its_own() {
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    let error = load(&root.path().join("sparse/0")).expect_err("a part").to_string();
    assert!(error.contains("the dataset is two folders above it"), "{error}");
    let root = laid_out("sparse/aligned", "images");
    let error = load(&root.path().join("sparse/aligned")).expect_err("a part").to_string();
    assert!(error.contains("the dataset is two folders above it"), "{error}");
    // The error names a dataset deeper down.
    let outer = tempfile::tempdir().expect("temporary folder");
    let inner = outer.path().join("job/dense/0");
    fs::create_dir_all(inner.parent().expect("parent")).expect("folder");
    fs::rename(root.path(), &inner).expect("moved");
    let error = load(outer.path()).expect_err("above").to_string();
    assert!(error.contains(&format!("there is one in {}", inner.display())), "{error}");
}

#[test]
fn photographs_in_another_folder_are_told_with_it() {
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    move_into(&root.path().join("images"), &root.path().join("photos"));
    let error = load(root.path()).expect_err("elsewhere").to_string();
    assert!(error.contains("all of them are in photos: set `images` to photos"), "{error}");
}

#[test]
fn cameras_of_other_programs_are_named_as_what_they_are() {
    let metashape = r#"<?xml version="1.0" encoding="UTF-8"?><document version="2.0.0"><chunk label="Chunk 1"><sensors/><cameras/></chunk></document>"#;
    let csv = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\na.png,1,2,3,4,5,6,7,8,9,0,0,0,0,0,0\n";
    for (name, content, words) in [
        ("cameras.xml", metashape, &["Metashape", "COLMAP"][..]),
        ("export/doc.xml", metashape, &["Metashape", "export/doc.xml"]),
        ("poses.csv", csv, &["RealityCapture", "poses.csv", "COLMAP"]),
        ("poses.csv", "\u{feff}#name, x, y, alt, heading\r\n", &["RealityCapture"]),
        ("poses_bounds.npy", "\u{1}NUMPY", &["LLFF", "poses_bounds.npy"]),
        ("bundle.out", "# Bundle file v0.3\n3 12\n", &["Bundler", "bundle.out"]),
        ("model.nvm", "NVM_V3\n\n3\n", &["VisualSFM", "model.nvm"]),
        ("params/p_calibrated_camera_parameters.txt", "fileName imageWidth", &["Pix4D", "OPF"]),
        ("blocks.xml", "<BlocksExchange version=\"3.2\">", &["BlocksExchange"]),
        ("database.db", "SQLite format 3\0", &["database of COLMAP", "mapper"]),
        (
            "sparse/0/cameras.txt",
            "1 PINHOLE 24 16 20 20 12 8\n",
            &["sparse/0/cameras.txt", "images.txt is not beside it"],
        ),
        ("images.bin", "", &["images.bin", "cameras.bin is not beside it"]),
    ] {
        for photographs in [true, false] {
            let root = tempfile::tempdir().expect("temporary folder");
            let file = root.path().join(name);
            fs::create_dir_all(file.parent().expect("parent")).expect("folder");
            fs::write(&file, content).expect("written");
            if photographs {
                Folder::ring(&NAMES, [0.0; 3]).write_photographs(&root.path().join("images"));
            }
            let error = load(root.path()).expect_err("foreign").to_string();
            assert!(!error.contains("nothing says where"), "{error}");
            for word in words {
                assert!(error.contains(word), "{name}: no '{word}' in {error}");
            }
        }
    }
    // Other files with these extensions are not taken for cameras.
    let root = tempfile::tempdir().expect("temporary folder");
    Folder::ring(&NAMES, [0.0; 3]).write_photographs(&root.path().join("images"));
    for (name, content) in
        [("table.csv", "name,x,y\n"), ("page.xml", "<html/>"), ("log.out", "done\n"), ("a.json", "{}")]
    {
        fs::write(root.path().join(name), content).expect("written");
    }
    let error = load(root.path()).expect_err("no cameras").to_string();
    assert!(error.contains("nothing says where they were taken from"), "{error}");
}

#[test]
fn parts_of_a_model_of_two_kinds_are_told() {
    let root = Folder::ring(&NAMES, [0.0; 3]).dataset(false);
    let sparse = root.path().join("sparse/0");
    fs::rename(sparse.join("cameras.bin"), sparse.join("cameras.txt")).expect("renamed");
    let error = load(root.path()).expect_err("mixed").to_string();
    assert!(error.contains("both have to be .bin or both .txt"), "{error}");
}
