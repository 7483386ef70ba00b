//! Exposures of a world with known gains. Gains act on light, before the camera's response curve, so that no affine map
//! of encoded colours equals a gain. Compared is the effect of maps on the colours of photographs.

use std::path::Path;

use psrgs_vk::dataset::{Dataset, LoadOptions, Split, Tracks};
use psrgs_vk::train::prepare::{ExposureEvidence, Setup, SetupEvent, SetupRequest, decide_exposures};
use psrgs_vk::train::settings::{Background, Exposure};
use psrgs_vk::train::{ExposureMatrix, Input, Pacing, Settings, Trainer, prepare};
use psrgs_vk::world::{Effect, Effects, LidarParams, World, WorldParams, generate};

use crate::common;

/// Brighter values lie at the end of the curve and do not show the gain.
const BRIGHT: u8 = 250;

/// The camera's response: extended Reinhard curve, then that of sRGB, from light to 0..1.
fn response(light: f64) -> f64 {
    let x = 1.32 * light;
    let y = (x * (1.0 + x / (2.6 * 2.6)) / (1.0 + x)).min(1.0);
    if y <= 0.003_130_8 { 12.92 * y } else { 1.055 * y.powf(1.0 / 2.4) - 0.055 }
}

/// Inverse of [`response`].
fn light(value: f64) -> f64 {
    let y = if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) };
    let (a, b) = (1.0 / (2.6 * 2.6), 1.0 - y);
    ((b * b + 4.0 * a * y).sqrt() - b) / (2.0 * a) / 1.32
}

/// The gain that changes the mean of a picture as `map` does.
fn gain(clean: &[[u8; 3]], map: &ExposureMatrix) -> f64 {
    let encoded = |pixel: &[u8; 3]| pixel.map(|v| f64::from(v) / 255.0);
    let shown = |c: [f64; 3]| map.iter().map(|row| row[3] + (0..3).map(|k| row[k] * c[k]).sum::<f64>()).sum::<f64>();
    let wanted: f64 = clean.iter().map(|pixel| shown(encoded(pixel))).sum();
    let lights: Vec<f64> = clean.iter().flat_map(|pixel| encoded(pixel).map(light)).collect();
    let (mut low, mut high) = (0.5, 2.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        let sum: f64 = lights.iter().map(|l| response(middle * l)).sum();
        if sum < wanted { low = middle } else { high = middle }
    }
    low
}

#[test]
fn the_response_is_that_of_the_world() {
    for value in [0.0, 0.01, 0.2, 0.5, 0.9] {
        assert!((response(light(value)) - value).abs() < 1e-12, "{value}");
    }
    let mut identity = [[0.0; 4]; 3];
    (0..3).for_each(|k| identity[k][k] = 1.0);
    assert!((gain(&[[20, 90, 200], [3, 60, 120]], &identity) - 1.0).abs() < 1e-9);
    // A photograph of the world is its clean picture at this gain, up to rounding.
    let mut effects = Effects::none();
    effects.take(Effect::Exposure, &Effects::default());
    let params = WorldParams { images: 4, max_side: 48, extent: 40.0, effects, ..WorldParams::default() };
    let world = World::new(&params).expect("a world");
    for (k, view) in (0..).zip(world.views()) {
        let shot = world.shot(view, k);
        let off = shot.clean.pixels().zip(shot.photograph.pixels()).flat_map(|(clean, taken)| {
            (0..3).map(move |c| (f64::from(clean.0[c]), f64::from(taken.0[c]))).filter(|(clean, _)| *clean < 250.0)
        });
        let off = off.map(|(clean, taken)| 255.0 * response(world.exposure(k) * light(clean / 255.0)) - taken);
        assert!(off.fold(0.0, |most: f64, v| most.max(v.abs())) < 1.3, "photograph {k}");
    }
}

/// Geometry comes from laser points. Random backgrounds make transparency visible: on black, a model that is not opaque
/// yet is darker from above than at a slant, and the maps would compensate.
#[test]
fn gains_of_the_world_are_found_to_a_hundredth() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut effects = Effects::none();
    effects.take(Effect::Exposure, &Effects::default());
    let params = WorldParams {
        images: 12,
        max_side: 96,
        extent: 40.0,
        nadir_share: 1.0,
        pixels_per_point: 6,
        offpath: 0,
        lidar: LidarParams { density: 5.0, ..LidarParams::default() },
        effects,
        ..WorldParams::default()
    };
    generate(&params, folder.path(), &mut |_| ()).expect("a world");
    let world = World::new(&params).expect("a world");
    let options = LoadOptions { split: Split::None, ..LoadOptions::default() };
    let dataset = Dataset::load(folder.path(), &options).expect("loads");
    let mut settings = Settings::default();
    settings.run.iterations = 2000;
    settings.run.eval_every = 0;
    settings.density.no_densify = true;
    settings.run.init = Some(folder.path().join("lidar.ply"));
    settings.model.sh_degree = 0;
    settings.model.background = Background::Random;
    settings.optimiser.exposure = Exposure::Affine;
    settings.optimiser.lr_exposure_final = 1e-4;
    settings.optimiser.lr_opacities = 0.1;
    let input = prepare::input(&dataset, &settings).expect("an input");
    let mut trainer = Trainer::new(&gpu, input, &settings, Pacing::default(), None).expect("trainer");
    while trainer.next_message().expect("message").is_some() {}
    let maps = trainer.exposures().expect("read").expect("exposures are on");
    assert_eq!(maps.len(), 12);

    let found: Vec<(f64, f64)> = (0..)
        .zip(world.views())
        .map(|(number, view)| {
            let (_, map) = maps
                .iter()
                .find(|(name, _)| Path::new(name).file_stem() == Path::new(&view.name).file_stem())
                .expect("a map");
            let (clean, _) = world.clean(&view.camera);
            let clean: Vec<[u8; 3]> = clean.pixels().map(|p| p.0).filter(|p| p.iter().all(|v| *v < BRIGHT)).collect();
            (world.exposure(number), gain(&clean, map))
        })
        .collect();
    let mean = |of: fn(&(f64, f64)) -> f64| (found.iter().map(|f| of(f).ln()).sum::<f64>() / found.len() as f64).exp();
    let (truth, own) = (mean(|f| f.0), mean(|f| f.1));
    let off: Vec<f64> = found.iter().map(|(t, f)| (f / own) / (t / truth) - 1.0).collect();
    let spread = |of: fn(f64, f64) -> f64| found.iter().map(|f| f.0 / truth).fold(1.0, of);
    println!("gains from {:.3} to {:.3}, found with errors {off:.4?}", spread(f64::min), spread(f64::max));
    assert!(spread(f64::max) - spread(f64::min) > 0.1, "the gains differ too little");
    assert!(off.iter().all(|e| e.abs() < 0.01), "{off:.4?}");
}

/// Photographs of a world whose exposures change by up to `change`, and by nothing else.
fn exposed_by(change: f64, images: u32, folder: &Path) -> (World, Dataset, Settings) {
    let effects = Effects { exposure: change, ..Effects::none() };
    let params = WorldParams {
        images,
        max_side: 96,
        extent: 40.0,
        pixels_per_point: 12,
        offpath: 0,
        effects,
        ..WorldParams::default()
    };
    generate(&params, folder, &mut |_| ()).expect("a world");
    let options = LoadOptions { split: Split::None, ..LoadOptions::default() };
    let dataset = Dataset::load(folder, &options).expect("loads");
    let mut settings = Settings::default();
    settings.run.iterations = 2;
    settings.optimiser.exposure = Exposure::Auto;
    (World::new(&params).expect("a world"), dataset, settings)
}

fn decided(dataset: &Dataset, input: &Input, settings: &Settings) -> (ExposureEvidence, Exposure) {
    let mut settings = settings.clone();
    let evidence = decide_exposures(dataset, input, &mut settings).expect("decided").expect("it was left open");
    println!("{evidence}");
    assert_eq!(decide_exposures(dataset, input, &mut settings).expect("decided"), None, "once and for all");
    (evidence, settings.optimiser.exposure)
}

#[test]
fn points_tell_whether_exposures_vary() {
    let folders = [(); 2].map(|()| tempfile::tempdir().expect("a temporary folder"));
    let (world, mut dataset, settings) = exposed_by(0.5, 20, folders[0].path());
    let input = prepare::input(&dataset, &settings).expect("an input");
    let (evidence, outcome) = decided(&dataset, &input, &settings);
    assert_eq!(outcome, Exposure::Affine);
    let ExposureEvidence::Colours(found) = evidence else { panic!("{evidence:?}") };
    // Brighter photographs have higher gains. Light is not what is encoded, so that they are not the same numbers.
    let pairs: Vec<[f64; 2]> =
        (0..).zip(&found.gains).filter_map(|(k, gains)| Some([world.exposure(k).ln(), (*gains)?[1].log])).collect();
    assert!(pairs.len() > 15, "{pairs:?}");
    let mean = |k: usize| pairs.iter().map(|pair| pair[k]).sum::<f64>() / pairs.len() as f64;
    let sum = |a: usize, b: usize| pairs.iter().map(|p| (p[a] - mean(a)) * (p[b] - mean(b))).sum::<f64>();
    let correlation = sum(0, 1) / (sum(0, 0) * sum(1, 1)).sqrt();
    assert!(correlation > 0.95, "{correlation} {pairs:.3?}");
    // Without tracks the points in front are taken.
    dataset.tracks = Tracks::default();
    assert_eq!(decided(&dataset, &input, &settings).1, Exposure::Affine);
    let (_, steady, settings) = exposed_by(0.0, 12, folders[1].path());
    let input = prepare::input(&steady, &settings).expect("an input");
    assert_eq!(decided(&steady, &input, &settings).1, Exposure::Off);
}

/// A file that notes an exposure of one part of a second.
fn noting(part: u32, sensitivity: u16) -> Vec<u8> {
    use exif::{Field, In, Rational, Tag, Value, experimental::Writer};
    let field = |tag, value| Field { tag, ifd_num: In::PRIMARY, value };
    let fields = [
        field(Tag::ExposureTime, Value::Rational(vec![Rational { num: 1, denom: part }])),
        field(Tag::FNumber, Value::Rational(vec![Rational { num: 28, denom: 10 }])),
        field(Tag::PhotographicSensitivity, Value::Short(vec![sensitivity])),
    ];
    let mut writer = Writer::new();
    fields.iter().for_each(|field| writer.push_field(field));
    let mut tiff = std::io::Cursor::new(Vec::new());
    writer.write(&mut tiff, false).expect("fields");
    let length = (8 + tiff.get_ref().len() as u16).to_be_bytes();
    [&[0xff, 0xd8, 0xff, 0xe1], &length[..], b"Exif\0\0", tiff.get_ref(), &[0xff, 0xd9]].concat()
}

/// Equal exposures are taken for granted where nothing speaks against it.
#[test]
fn without_points_the_files_tell_of_exposures_or_nothing_does() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (_, mut dataset, settings) = exposed_by(0.5, 4, folder.path());
    let input = prepare::input(&dataset, &settings).expect("an input");
    dataset.points.clear();
    dataset.tracks = Tracks::default();
    assert_eq!(decided(&dataset, &input, &settings), (ExposureEvidence::Nothing, Exposure::Off));
    // Half the time at twice the sensitivity is the same exposure.
    for (k, view) in dataset.views.iter_mut().enumerate() {
        view.path = folder.path().join(format!("{k}.jpg"));
        let (part, sensitivity) = if k % 2 == 0 { (500, 100) } else { (1000, 200) };
        std::fs::write(&view.path, noting(part, sensitivity)).expect("written");
    }
    let exposure = dataset.views[0].noted_exposure().expect("noted");
    assert!((exposure * 2.8 * 2.8 - 0.2).abs() < 1e-9, "{exposure}");
    let (evidence, outcome) = decided(&dataset, &input, &settings);
    assert!(matches!(evidence, ExposureEvidence::Noted(spread) if spread < 1e-9) && outcome == Exposure::Off);
    std::fs::write(&dataset.views[3].path, noting(250, 100)).expect("written");
    let (evidence, outcome) = decided(&dataset, &input, &settings);
    assert!(matches!(evidence, ExposureEvidence::Noted(spread) if spread > 0.1) && outcome == Exposure::Affine);
    std::fs::write(&dataset.views[3].path, b"no picture").expect("written");
    assert_eq!(decided(&dataset, &input, &settings).1, Exposure::Off, "the others agree");
}

/// A run that goes on takes what was decided from its checkpoint.
#[test]
fn a_run_that_goes_on_decides_nothing_of_exposures() {
    let Some(gpu) = common::gpu() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (_, mut dataset, settings) = exposed_by(0.5, 16, folder.path());
    for outcome in [Exposure::Affine, Exposure::Off] {
        let prepared = |restart| {
            let mut told = 0;
            let (settings, dataset) = (&settings, &dataset);
            let request = SetupRequest {
                settings,
                dataset,
                weights: None,
                restart,
                part: None,
                keep_no_photographs: false,
                cache: None,
            };
            let mut tell = |event: SetupEvent<'_>| told += u32::from(matches!(event, SetupEvent::ExposuresDecided(_)));
            let setup = Setup::prepare(&gpu, request, &mut tell).expect("ready");
            (setup, told)
        };
        let (setup, told) = prepared(None);
        assert_eq!((setup.settings.optimiser.exposure, told), (outcome, 1));
        let mut trainer = Trainer::new(&gpu, setup.input, &setup.settings, setup.host.pacing, None).expect("trainer");
        while trainer.next_message().expect("message").is_some() {}
        let restart = trainer.snapshot().expect("a snapshot");
        let (setup, told) = prepared(Some(restart));
        assert_eq!((setup.settings.optimiser.exposure, told), (outcome, 0));
        // Random points have no colours to compare.
        dataset.points.clear();
        dataset.tracks = Tracks::default();
    }
}
