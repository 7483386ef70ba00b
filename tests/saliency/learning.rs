//! Learning sigma: from every start, the loss comes within a tenth of the best loss of a grid search.

use psrgs_vk::saliency::{
    Agreement, Curve, Error, Features, LearnSettings, MaskTarget, Plane, Renders, Settings, SigmaLearner, Spectrum,
    agreement, spaced,
};

use crate::images::{drawn, patch, waves};

const UPDATES: usize = 150;

/// Fast learning, for images with only a few dozen updates.
fn quick(start: f64) -> LearnSettings {
    LearnSettings { start, rate: 0.03, ..LearnSettings::default() }
}

/// An image, a target whose best mask has a sigma near `at` (only near, because the share of the target differs), and
/// the loss over sigma.
struct Case {
    spectrum: Spectrum,
    target: MaskTarget,
    curve: Curve,
}

fn case(image: &Plane, at: f64) -> Case {
    let spectrum = Spectrum::new(image, &Settings { blur: 8.0, ..Settings::default() }).expect("a spectrum");
    let errors = spectrum.map(at).expect("a map").plane();
    let target = MaskTarget::of_errors(&errors, spectrum.size(), 0.0, 0.25).expect("a target");
    let curve = Curve::of_target(&spectrum, &target, &spaced(0.5, 12.0, 40)).expect("a curve");
    Case { spectrum, target, curve }
}

/// Three images whose best sigmas are far apart, if `third` is large.
fn cases(third: f64) -> [Case; 3] {
    [case(&waves(72, 54, 1), 3.0), case(&waves(72, 60, 21), 6.0), case(&waves(60, 72, 5), third)]
}

/// Sigma after training on one image.
fn trained(case: &Case, start: f64) -> f64 {
    trained_by(case, &quick(start))
}

fn trained_by(case: &Case, settings: &LearnSettings) -> f64 {
    let start = settings.start;
    let mut learner = SigmaLearner::new(&[*case.spectrum.features()], settings).expect("a learner");
    let at_first = learner.choose(case.spectrum.features());
    assert!((at_first.sigma - start).abs() < 1e-9 && at_first.level == 0.0, "{at_first:?}");
    for _ in 0..UPDATES {
        let update = learner.learn_from_target(&case.spectrum, &case.target).expect("an update");
        assert!(update.is_some());
    }
    learner.choose(case.spectrum.features()).sigma
}

/// The loss at a sigma over the best loss, minus 1.
fn above(case: &Case, sigma: f64) -> f64 {
    let best = case.curve.best().expect("a point").1;
    case.curve.loss(sigma).expect("a loss") / best - 1.0
}

#[test]
fn every_start_leads_to_the_best_sigma() {
    for (i, case) in cases(4.5).iter().enumerate() {
        let starts = [1.0, 3.0, 10.0];
        let ends = starts.map(|start| trained(case, start));
        for sigma in ends {
            assert!(above(case, sigma) < 0.1, "image {i}: {ends:?}: {sigma} is {} above", above(case, sigma));
        }
        // Without learning, some starts are far from the best loss.
        let worst = starts.map(|start| above(case, start)).into_iter().fold(0.0, f64::max);
        assert!(worst > 0.3, "image {i}: {worst}");
        let verdict = agreement(&case.curve, &ends, 0.2, 0.01).expect("a verdict");
        assert!(matches!(verdict, Agreement::Agree { .. }), "image {i}: {ends:?}: {verdict:?}");
    }
}

/// A loss over sigma can have two minima. Gradient steps alone end in the nearer minimum, and the verdict says so. With
/// samples of the whole range they end in the lower minimum.
#[test]
fn a_hill_between_two_valleys_does_not_hold_learning_up() {
    let [_, _, case] = cases(10.0);
    let downhill = |start| trained_by(&case, &LearnSettings { outlook: 0, ..quick(start) });
    let ends = [downhill(1.0), downhill(10.0)];
    assert!(above(&case, ends[0]) > 0.3 && above(&case, ends[1]) < 0.1, "{ends:?}");
    let verdict = agreement(&case.curve, &ends, 0.2, 0.01).expect("a verdict");
    assert!(matches!(verdict, Agreement::Differ { .. }), "{ends:?}: {verdict:?}");

    let ends = [1.0, 3.0, 10.0].map(|start| trained(&case, start));
    assert!(ends.iter().all(|sigma| above(&case, *sigma) < 0.1), "{ends:?}");
    let verdict = agreement(&case.curve, &ends, 0.2, 0.01).expect("a verdict");
    assert!(matches!(verdict, Agreement::Agree { .. }), "{ends:?}: {verdict:?}");
}

#[test]
fn one_network_tells_images_apart() {
    let cases = cases(10.0);
    let features: Vec<Features> = cases.iter().map(|c| *c.spectrum.features()).collect();
    let mut learner = SigmaLearner::new(&features, &quick(3.0)).expect("a learner");
    for _ in 0..UPDATES {
        for case in &cases {
            learner.learn_from_target(&case.spectrum, &case.target).expect("an update");
        }
    }
    assert_eq!(learner.updates(), 3 * UPDATES as u64);
    for (i, case) in cases.iter().enumerate() {
        let sigma = learner.choose(case.spectrum.features()).sigma;
        assert!(above(case, sigma) < 0.1, "image {i}: {sigma} is {} above", above(case, sigma));
    }
    // No single sigma is good for all images.
    let all = |sigma: f64| cases.iter().map(|c| above(c, sigma)).fold(0.0, f64::max);
    assert!(spaced(0.5, 12.0, 40).into_iter().all(|sigma| all(sigma) > 0.1));
}

/// A training of 1,500 steps has two or three updates per image, between those of all others.
#[test]
fn three_updates_of_each_of_many_images_are_enough() {
    let images: Vec<Case> =
        (0..12u32).map(|k| case(&waves(48 + 2 * k, 60, k.into()), 1.5 * 1.17f64.powi(k as i32))).collect();
    let features: Vec<Features> = images.iter().map(|c| *c.spectrum.features()).collect();
    let ends = |settings: &LearnSettings| -> Vec<f64> {
        let mut learner = SigmaLearner::new(&features, settings).expect("a learner");
        for _ in 0..3 {
            for case in &images {
                learner.learn_from_target(&case.spectrum, &case.target).expect("an update");
            }
        }
        assert_eq!(learner.updates(), 3 * images.len() as u64);
        features.iter().map(|f| learner.choose(f).sigma).collect()
    };
    let agree = |recall: usize| {
        let of = [1.0, 3.0, 10.0].map(|start| ends(&LearnSettings { start, recall, ..LearnSettings::default() }));
        let alike = |i: &usize| {
            let sigmas = of.each_ref().map(|ends| ends[*i]);
            let [least, most] = [f64::min, f64::max].map(|f| sigmas.into_iter().fold(sigmas[0], f));
            most < 1.2 * least && sigmas.iter().all(|sigma| above(&images[*i], *sigma) < 0.1)
        };
        (0..images.len()).filter(alike).count()
    };
    let (with, without) = (agree(LearnSettings::default().recall), agree(0));
    assert!(
        with >= 11 && without <= 4,
        "{with} and {without} of 12 images agree from all starts, near their best loss"
    );
}

#[test]
fn learning_repeats_and_goes_on_where_it_was() {
    let case = case(&waves(40, 30, 1), 6.0);
    let errors = waves(40, 30, 7);
    let update = |learner: &mut SigmaLearner| {
        learner.learn_from_target(&case.spectrum, &case.target).expect("an update");
        learner.learn_from_errors(&case.spectrum, &errors).expect("an update").expect("something to learn")
    };
    let new = || SigmaLearner::new(&[*case.spectrum.features(), Features([0.5; 16])], &quick(3.0)).expect("a learner");
    let (mut straight, mut broken) = (new(), new());
    (0..4).for_each(|_| assert_eq!(update(&mut straight), update(&mut broken)));
    let json = serde_json::to_string(&broken).expect("JSON");
    let mut restored: SigmaLearner = serde_json::from_str(&json).expect("a learner");
    assert_eq!(restored, straight);
    (0..4).for_each(|_| assert_eq!(update(&mut straight), update(&mut restored)));
    assert_eq!(restored, straight);

    type Damage = fn(&mut serde_json::Value);
    let damages: [(&str, Damage); 5] = [
        ("version", |v| v["version"] = 9.into()),
        ("parameters", |v| v["network"]["parameters"] = vec![0.0; 3].into()),
        ("parameters", |v| v["adam"]["second"][5] = (-1.0).into()),
        ("moments", |v| v["recall"]["found"][0]["weight"] = (-1.0).into()),
        ("start", |v| v["settings"]["start"] = 50.0.into()),
    ];
    for (word, damage) in damages {
        let mut value: serde_json::Value = serde_json::from_str(&json).expect("JSON");
        damage(&mut value);
        let error = serde_json::from_value::<SigmaLearner>(value).expect_err(word).to_string();
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn a_price_decides_how_much_is_texture() {
    let image = patch(64, 48, (20.0, 10.0), 24.0, 2);
    let spectrum = Spectrum::new(&image, &Settings { blur: 8.0, ..Settings::default() }).expect("a spectrum");
    let rgb = |plane: &Plane| -> Vec<f32> { plane.values().iter().flat_map(|v| [*v; 3]).collect() };
    let (full, low) = (rgb(&image), rgb(&image.resized(8, 6).resized(64, 48)));
    let renders = Renders { low: &low, full: &full, photograph: &full };
    let mean = |learner: &SigmaLearner| {
        let choice = learner.choose(spectrum.features());
        let mask = spectrum.map(choice.sigma).expect("a map").mask(choice.level).values();
        mask.iter().sum::<f64>() / mask.len() as f64
    };
    let learned = |price: f64| {
        let settings = LearnSettings { price, ..quick(3.0) };
        let mut learner = SigmaLearner::new(&[*spectrum.features()], &settings).expect("a learner");
        assert!((mean(&learner) - 0.3).abs() < 1e-6);
        let mut losses = Vec::new();
        for _ in 0..60 {
            losses.push(learner.learn_from_composite(&spectrum, &renders).expect("an update").expect("one").loss);
        }
        assert!(losses[59] < losses[0], "{} to {}", losses[0], losses[59]);
        mean(&learner)
    };
    let (cheap, dear) = (learned(0.0), learned(0.3));
    assert!(cheap > 0.34 && dear < 0.26, "{cheap} and {dear}");
    let mut learner = SigmaLearner::new(&[*spectrum.features()], &quick(3.0)).expect("a learner");
    let wrong = Renders { low: &low[3..], ..renders };
    assert!(matches!(learner.learn_from_composite(&spectrum, &wrong), Err(Error::Size { .. })));
}

#[test]
fn nothing_is_learned_where_there_is_nothing() {
    let grey = Plane::new(20, 16, vec![0.4; 320]).expect("an image");
    let flat = Spectrum::new(&grey, &Settings::default()).expect("a spectrum");
    let other = Spectrum::new(&waves(20, 16, 1), &Settings::default()).expect("a spectrum");
    let mut learner =
        SigmaLearner::new(&[*flat.features(), *other.features()], &LearnSettings::default()).expect("a learner");
    let before = learner.clone();
    assert_eq!(learner.learn_from_errors(&flat, &waves(20, 16, 2)), Ok(None));
    assert_eq!(learner.learn_from_errors(&other, &grey), Ok(None));
    let picture = vec![0.5; 960];
    let renders = Renders { low: &picture, full: &picture, photograph: &picture };
    assert_eq!(learner.learn_from_composite(&flat, &renders), Ok(None));
    assert_eq!(learner, before);
    // No image at all, and one pixel.
    assert!(SigmaLearner::new(&[], &LearnSettings::default()).expect("a learner").choose(flat.features()).sigma > 0.0);
    let one = Plane::new(1, 1, vec![0.4]).expect("an image");
    let one = Spectrum::new(&one, &Settings::default()).expect("a spectrum");
    assert_eq!(learner.learn_from_errors(&one, &grey), Ok(None));
    let settings = LearnSettings { start: 12.0, ..LearnSettings::default() };
    assert!(matches!(SigmaLearner::new(&[], &settings), Err(Error::Setting { name: "start", .. })));
}

#[test]
fn targets_are_the_largest_errors() {
    let errors = drawn(20, 10, |x, _| x / 20.0);
    let target = MaskTarget::of_errors(&errors, (20, 10), 0.0, 0.25).expect("a target");
    let wanted: Vec<f64> = (0..200).map(|i| if i % 20 >= 15 { 1.0 } else { 0.0 }).collect();
    let count = target.values().iter().sum::<f64>();
    assert!((40.0..=50.0).contains(&count), "{count}");
    assert!(target.values().iter().zip(&wanted).all(|(t, w)| t <= w));
    assert_eq!(target.size(), (20, 10));
    let one = drawn(20, 10, |x, y| if (x, y) == (3.0, 4.0) { 1.0 } else { 0.0 });
    let target = MaskTarget::of_errors(&one, (20, 10), 0.0, 0.25).expect("a target");
    assert_eq!(target.values().iter().position(|t| *t == 1.0), Some(83));
    assert_eq!(target.values().iter().sum::<f64>(), 1.0);
}

#[test]
fn a_curve_says_when_sigma_does_not_matter() {
    let steep = Curve::new(vec![(4.0, 2.0), (1.0, 1.5), (2.0, 1.0)]);
    assert_eq!(steep.best(), Some((2.0, 1.0)));
    for (sigma, loss) in [(0.5, 1.5), (1.0, 1.5), (2.0_f64.sqrt(), 1.25), (2.0, 1.0), (4.0, 2.0), (9.0, 2.0)] {
        let found = steep.loss(sigma).expect("a loss");
        assert!((found - loss).abs() < 1e-12, "{sigma}: {found}");
    }
    assert_eq!(steep.rise(1.0, 4.0), Some(1.0));
    // A minimum between two equal ends counts.
    assert!((steep.rise(1.0, 2.0_f64.powf(1.5)).expect("a rise") - 0.5).abs() < 1e-12);
    let flat = Curve::new(vec![(1.0, 1.0), (2.0, 1.004), (4.0, 1.002)]);
    let judge = |curve: &Curve, trained: &[f64]| agreement(curve, trained, 0.2, 0.01);
    assert!(
        matches!(judge(&steep, &[2.0, 2.2, 2.1]), Some(Agreement::Agree { spread }) if (spread - 0.1).abs() < 1e-9)
    );
    assert!(matches!(judge(&steep, &[1.0, 2.0, 4.0]), Some(Agreement::Differ { spread: 3.0, rise: 1.0 })));
    assert!(matches!(judge(&flat, &[4.0, 1.0, 2.0]), Some(Agreement::Flat { spread: 3.0, .. })));
    assert_eq!(judge(&flat, &[]), None);
    assert_eq!(judge(&Curve::new(vec![]), &[1.0]), None);
}
