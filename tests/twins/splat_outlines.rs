//! `splat_outlines` against the twin in double precision, on the scenes of the blending tests, and what an outline is.

use psrgs_vk::pass::depth_probe::groups;
use psrgs_vk::pass::splat_outlines::{FILL, PASS, Push, RADIUS};
use psrgs_vk::scene::tile::ALPHA_MIN;
use psrgs_vk::twin::blend_forward::Blend;
use psrgs_vk::twin::splat_outlines::outlines;
use psrgs_vk::vk::Gpu;

use super::blend_forward::some;
use super::blend_scene::{hard_scenes, widen};
use super::harness::{self, bytes, garbage};

/// A pixel counts where single and double precision agree this well: near a needle's mean the distance in pixels is the
/// quotient of two small numbers.
const AGREED: f64 = 1e-4;

pub fn run(gpu: &Gpu) {
    an_outline_is_a_line_at_two_deviations();
    let (mut compared, mut drawn, mut pixels) = (0, 0, 0);
    for scene in hard_scenes() {
        for side in [8, 16] {
            let blend = scene.blend(side, false);
            let wide = outlines(&widen::<f64>(&blend));
            let [red, green, blue] = blend.background;
            let (width, height) = (blend.width as u32, blend.height as u32);
            let push = Push { width, height, side: side as u32, red, green, blue };
            let buffers = [some(&blend.splats), some(&blend.sorted), bytes(&blend.ranges), garbage(4 * wide.len())];
            let outcome = harness::run(gpu, &PASS, &[], &buffers, &push, groups(width, height));
            let (device, twin) = (outcome.device::<[f32; 4]>(3), outcome.twin::<[f32; 4]>(3));
            for (pixel, want) in wide.iter().enumerate() {
                let off = |got: &[f32; 4]| (0..4).map(|k| (f64::from(got[k]) - want[k]).abs()).fold(0.0, f64::max);
                pixels += 1;
                if off(&twin[pixel]) <= AGREED {
                    compared += 1;
                    drawn += usize::from(want[3] < 0.9);
                    let (got, name) = (device[pixel], scene.name);
                    assert!(off(&got) <= 10.0 * AGREED, "{name}, tiles of {side}: pixel {pixel}: {got:?}, {want:?}");
                }
            }
        }
    }
    println!("{compared} of {pixels} pixels compared, {drawn} of them with outlines");
    assert!(20 * compared > 19 * pixels && drawn > 2000, "{compared} of {pixels} compared, {drawn} drawn");
}

/// One round splat of 5 pixels: (alpha at the middle, on the outline, halfway, outside).
fn an_outline_is_a_line_at_two_deviations() {
    let (sigma, opacity) = (5.0, 0.8);
    let conic = 1.0 / (sigma * sigma);
    let splat = [20.5, 20.5, conic, 0.0, conic, opacity, 3.0, conic, 1.0, 0.5, 0.0, 0.0];
    let blend: Blend<f64> = Blend {
        width: 41,
        height: 41,
        background: [0.0; 3],
        side: 48,
        splats: vec![splat],
        normals: None,
        sorted: vec![0],
        ranges: vec![[0, 1]],
        block: None,
        alpha_min: ALPHA_MIN,
    };
    let image = outlines(&blend);
    let alpha = |x: usize| 1.0 - image[20 * 41 + x][3];
    let (radius, fill) = (f64::from(RADIUS), f64::from(FILL));
    let inside = |d: f64| opacity * fill * (-0.5 * (d / sigma) * (d / sigma)).exp();
    for (x, want) in
        [(20, inside(0.0)), (20 + (radius * sigma) as usize, opacity), (25, inside(5.0)), (40, inside(20.0))]
    {
        assert!((alpha(x) - want).abs() < 1e-9, "column {x}: {} in place of {want}", alpha(x));
    }
    assert!((image[20 * 41 + 30][1] - 0.5 * opacity).abs() < 1e-9, "the colour is the splat's");
}
