//! Photographs are decoded in turns within a share of the host's memory, and results do not depend on the share.

use std::sync::Mutex;

use psrgs_vk::dataset::{Dataset, HostShare, LoadOptions, Role, Split};
use psrgs_vk::stereo::{InitialPlanes, MemoryEstimate, Scene, Settings, StereoView};
use psrgs_vk::train::settings::DepthPrior;
use psrgs_vk::train::{self, compute_stereo_priors, prepare};
use psrgs_vk::world::{LidarParams, WorldParams, generate};

use super::common;

pub(super) fn world(folder: &std::path::Path, max_side: u32) -> Dataset {
    let lidar = LidarParams { density: 0.1, ..LidarParams::default() };
    let params =
        WorldParams { images: 9, max_side, seed: 5, pixels_per_point: 40, offpath: 0, lidar, ..WorldParams::default() };
    generate(&params, folder, &mut |_| ()).expect("a world");
    let options = LoadOptions { split: Split::None, ..LoadOptions::default() };
    Dataset::load(folder, &options).expect("loads")
}

/// Bytes of a view's values.
fn held(view: &StereoView) -> u64 {
    let start = match &view.start {
        InitialPlanes::Hypotheses(rows) => 12 * rows.len(),
        _ => 0,
    };
    (4 * view.luma.len() + 3 * view.colours.len() + view.wanted.as_ref().map_or(0, Vec::len) + start) as u64
}

#[test]
fn what_is_being_decoded_stays_within_the_share() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = world(folder.path(), 192);
    let settings = Settings { max_side: 64, ..Settings::default() };
    let largest = dataset.views.iter().map(|view| view.decoding_bytes() + 16 * 192 * 144).max().expect("views");
    let all = Scene::of(&dataset, &settings, &HostShare::unlimited(), dataset_photograph).expect("decoded");
    assert_eq!(all.views.len(), 9);
    for (room, threads) in [(1, 4), (largest, 4), (2 * largest + 5, 4), (9 * largest, 1)] {
        // Bytes being decoded, and their peak.
        let inside = Mutex::new((0_u64, 0_u64));
        let share = HostShare { keep: 0, decoding: room, threads };
        let scene = Scene::of(&dataset, &settings, &share, |view| {
            let bytes = view.decoding_bytes() + 16 * 192 * 144;
            {
                let mut inside = inside.lock().expect("lock");
                inside.0 += bytes;
                inside.1 = inside.1.max(inside.0);
            }
            let photograph = view.photograph();
            inside.lock().expect("lock").0 -= bytes;
            photograph
        })
        .expect("decoded");
        let most = inside.into_inner().expect("lock").1;
        assert!(most > 0 && most <= room.max(largest), "{most} bytes at a time of {room}, on {threads} threads");
        assert!(scene == all, "the views differ");
    }
    // The views take the planned bytes, far less than the photographs.
    let sizes = || dataset.views.iter().map(|view| (view.camera.width, view.camera.height));
    let room = MemoryEstimate::of(&settings, sizes());
    let views: u64 = all.views.iter().map(held).sum();
    assert!(views <= room.host - room.results, "{views} bytes, {room:?}");
    assert!(views >= (room.host - room.results) / 2, "{views} bytes, {room:?}");
    assert_eq!(room.results, 9 * 64 * 48 * 20);
}

fn dataset_photograph(
    view: &psrgs_vk::dataset::View,
) -> Result<psrgs_vk::dataset::Photograph, psrgs_vk::dataset::Error> {
    view.photograph()
}

/// The first damaged file is named, whichever thread finds it.
#[test]
fn the_first_damaged_photograph_is_the_one_that_is_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = world(folder.path(), 64);
    let names: Vec<&str> = dataset.views_of(Role::Train).map(|(_, view)| view.name.as_str()).collect();
    for name in [names[3], names[6]] {
        std::fs::write(folder.path().join("images").join(name), b"no picture").expect("written");
    }
    for threads in [1, 4] {
        let share = HostShare { threads, ..HostShare::unlimited() };
        let error = Scene::of(&dataset, &Settings::default(), &share, dataset_photograph).expect_err("damaged");
        assert!(error.to_string().contains(names[3]), "{error}");
    }
}

/// Photographs that are kept decoded, kept compressed, or read again give equal depths.
#[test]
fn depths_to_train_with_do_not_depend_on_where_photographs_are() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let dataset = world(folder.path(), 96);
    let mut settings = train::Settings::default();
    settings.geometry.depth_prior = DepthPrior::Stereo;
    settings.geometry.stereo_side = 48;
    let depths = |keep: u64, threads: usize| {
        let share = HostShare { keep, decoding: 1, threads };
        let initial = prepare::initial(&dataset, &settings).expect("points");
        let mut input = prepare::input_within(&dataset, initial, share).expect("decoded");
        let report = compute_stereo_priors(&gpu, &dataset, &mut input, &settings, &share, true).expect("matched");
        (report, input.optional.priors)
    };
    let kept = depths(u64::MAX, 2);
    assert!(kept.0.views >= 5 && kept.0.share > 0.1, "{:?}", kept.0);
    for (keep, threads) in [(0, 1), (0, 3), (60_000, 2)] {
        assert!(depths(keep, threads) == kept, "{keep} bytes kept");
    }
}
