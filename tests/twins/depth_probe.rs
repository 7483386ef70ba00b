//! `depth_probe` against the f64 twin, on the scenes of the blending tests: with and without known depths, in tiles of
//! both sides.

use psrgs_vk::pass::depth_probe::{self, BEHIND, FRONT, Push};
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::tile::ALPHA_MIN;
use psrgs_vk::twin::blend_forward::{Blend, TRANSMITTANCE_MIN, evaluate, forward};
use psrgs_vk::twin::depth_probe::{Probed, probe};
use psrgs_vk::vk::Gpu;

use super::blend_forward::some;
use super::blend_scene::{EARLY_ALPHA_MIN, doubts, hard_scenes, widen};
use super::harness::{self, bytes, garbage};

/// Around the depths of the splats of a pixel's tile; at every fifth pixel none.
fn known_depths(blend: &Blend<f32>) -> Vec<f32> {
    let mut draws = Random::new(31);
    let one = |pixel: usize| {
        let (x, y) = (pixel % blend.width, pixel / blend.width);
        let list = blend.list(x, y);
        let (place, factor) = (draws.unit(), draws.range(0.9, 1.15));
        let splat = list.get((place * list.len() as f64) as usize);
        let depth = splat.map_or(3.0, |&splat| f64::from(blend.aux_of(splat as usize, x, y)[0]) * factor);
        if pixel.is_multiple_of(5) { 0.0 } else { depth as f32 }
    };
    (0..blend.width * blend.height).map(one).collect()
}

/// Transmittances behind the splats of a pixel with their depths, in double precision.
fn layers(blend: &Blend<f64>, pixel: usize) -> Vec<(f64, f64)> {
    let (x, y) = (pixel % blend.width, pixel / blend.width);
    let (mut transmittance, mut layers) = (1.0, Vec::new());
    for &splat in blend.list(x, y) {
        let row = &blend.splats[splat as usize];
        let next = transmittance * (1.0 - evaluate(row, Blend::center(x, y), blend.alpha_min).alpha());
        if next < f64::from(TRANSMITTANCE_MIN) {
            break;
        }
        transmittance = next;
        layers.push((transmittance, blend.aux_of(splat as usize, x, y)[0]));
    }
    layers
}

/// The twin, by the layers of each pixel. Its transmittance is that of the picture.
fn twin_is_right(blend: &Blend<f64>, known: &[f64], twin: &[Probed<f64>]) {
    let picture = forward(blend).image;
    for (pixel, (got, known)) in twin.iter().zip(known).enumerate() {
        let layers = layers(blend, pixel);
        let median = layers.iter().find(|layer| layer.0 <= 0.5).map_or(0.0, |layer| layer.1);
        let before = std::iter::once(1.0).chain(layers.iter().map(|layer| layer.0));
        let weights = before.zip(&layers).map(|(before, layer)| (before - layer.0, layer.1));
        let sum = |side: &dyn Fn(f64) -> bool| weights.clone().filter(|w| side(w.1)).map(|w| w.0).sum::<f64>();
        let (front, behind) = match *known > 0.0 {
            true => (sum(&|z| z < f64::from(FRONT) * known), sum(&|z| z > f64::from(BEHIND) * known)),
            false => (0.0, 0.0),
        };
        assert_eq!(got.median, median, "pixel {pixel}");
        assert!((got.front - front).abs() < 1e-12 && (got.behind - behind).abs() < 1e-12, "pixel {pixel}: {got:?}");
        assert_eq!(got.transmittance, picture[pixel][3], "pixel {pixel}");
    }
}

pub fn run(gpu: &Gpu) {
    let (mut fronts, mut behinds, mut medians, mut undecided, mut pixels) = (0.0, 0.0, 0, 0, 0);
    for scene in hard_scenes() {
        for (side, alpha_min, with_known) in [(8, ALPHA_MIN, true), (16, ALPHA_MIN, false), (16, EARLY_ALPHA_MIN, true)]
        {
            let blend = Blend { alpha_min, ..scene.blend(side, true) };
            let (wide, depths) = (widen::<f64>(&blend), known_depths(&blend));
            let known: Vec<f64> = depths.iter().map(|z| if with_known { f64::from(*z) } else { 0.0 }).collect();
            let want = probe(&wide, with_known.then_some(&known[..]));
            twin_is_right(&wide, &known, &want);

            let (width, height) = (blend.width as u32, blend.height as u32);
            let known_bytes = if with_known { bytes(&depths) } else { garbage(4) };
            let buffers = [
                some(&blend.splats),
                some(blend.normals.as_deref().unwrap_or_default()),
                some(&blend.sorted),
                bytes(&blend.ranges),
                known_bytes,
                garbage(4 * want.len()),
            ];
            let given = [("KNOWN", u32::from(with_known)), ("ALPHA_MIN", alpha_min.to_bits())];
            let push = Push { width, height, side: side as u32 };
            let groups = depth_probe::groups(width, height);
            let outcome = harness::run(gpu, &depth_probe::PASS, &given, &buffers, &push, groups);
            let what = format!("{}, tiles of {side}", scene.name);
            let (device, twin) = (outcome.device::<[f32; 4]>(5), outcome.twin::<[f32; 4]>(5));
            for (pixel, doubt) in doubts(&wide).iter().enumerate() {
                let exact = want[pixel];
                let layers = layers(&wide, pixel);
                let half = |t: f64| (t / 0.5 - 1.0).abs() <= doubt.transmittance + 1e-9;
                let border = |z: f64, share: f32| (z / (f64::from(share) * known[pixel]) - 1.0).abs() < 1e-6;
                let close = layers.iter().any(|(t, z)| half(*t) || border(*z, FRONT) || border(*z, BEHIND));
                pixels += 1;
                undecided += usize::from(close || doubt.undecided);
                if close || doubt.undecided {
                    continue;
                }
                for (who, got) in [("device", device[pixel]), ("twin", twin[pixel])] {
                    let off = |k: usize, exact: f64| (f64::from(got[k]) - exact).abs();
                    let median = off(0, exact.median) <= 1e-6 * exact.median;
                    assert!(median, "{who}: {what}: median of pixel {pixel}: {got:?}, {exact:?}");
                    let bound = doubt.weights + 1e-7;
                    let right = off(1, exact.front) <= bound && off(2, exact.behind) <= bound;
                    assert!(right, "{who}: {what}: pixel {pixel}: {got:?}, {exact:?}");
                    let bound = doubt.transmittance * exact.transmittance + 1e-9;
                    assert!(off(3, exact.transmittance) <= bound, "{who}: {what}: pixel {pixel}: {got:?}, {exact:?}");
                }
                fronts += exact.front;
                behinds += exact.behind;
                medians += usize::from(exact.median > 0.0);
            }
        }
    }
    println!("{undecided} of {pixels} pixels undecided, {medians} with a median depth");
    assert!(20 * undecided < pixels && medians > 2000, "{undecided} of {pixels} undecided, {medians} medians");
    assert!(fronts > 100.0 && behinds > 100.0, "front {fronts}, behind {behinds}");
}
