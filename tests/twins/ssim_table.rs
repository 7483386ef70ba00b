//! SSIM of the training loss and of the scores against numbers of another program, so that a constant or a window that
//! is wrong in all implementations here shows.
//!
//! The numbers come from scikit-image 0.26, in double precision. At the border its windows are mirrored, and windows
//! here see zeros. A frame of zeros makes both equal. `a` and `b` are arrays of integers (height, width, 3):
//!
//!     pad = lambda p: numpy.pad(p / 255.0, ((10, 10), (10, 10), (0, 0)))
//!     _, full = skimage.metrics.structural_similarity(
//!         pad(a), pad(b), data_range=1.0, channel_axis=2, gaussian_weights=True, sigma=1.5,
//!         use_sample_covariance=False, full=True)
//!     full[10:-10, 10:-10].mean()

use psrgs_vk::eval::ssim;
use psrgs_vk::twin::loss::loss;

use super::common;
use super::loss::{Pictures, With, on_device};

/// A picture by a formula, for use in other programs.
#[derive(Clone, Copy, Debug)]
enum Picture {
    /// All 8-bit values.
    Textured(usize),
    /// Seven neighbouring values, whose SSIM depends strongly on its constants.
    Faint(usize),
    Half,
    Inverted,
    Flat,
}

impl Picture {
    fn bytes(self, width: usize, height: usize) -> Vec<u8> {
        let place = |k: usize| (k / 3 % width, k / 3 / width, k % 3);
        let value = |k: usize, phase: usize| {
            let (x, y, c) = place(k);
            x * 7 + y * 13 + c * 29 + phase * (x * y % 11)
        };
        let of = |k: usize| match self {
            Self::Textured(phase) => value(k, phase) % 256,
            Self::Faint(phase) => 90 + value(k, phase) % 7,
            Self::Half => value(k, 0) % 256 / 2,
            Self::Inverted => 255 - value(k, 0) % 256,
            Self::Flat => 93,
        };
        (0..3 * width * height).map(|k| of(k) as u8).collect()
    }
}

const TABLE: [(usize, usize, Picture, Picture, f64); 10] = [
    (23, 17, Picture::Textured(0), Picture::Textured(3), 0.716387739358),
    (23, 17, Picture::Textured(0), Picture::Half, 0.643327160743),
    (23, 17, Picture::Textured(0), Picture::Inverted, -0.170116449560),
    (23, 17, Picture::Faint(0), Picture::Faint(3), 0.962096250871),
    (23, 17, Picture::Faint(0), Picture::Flat, 0.979757806171),
    (64, 48, Picture::Textured(0), Picture::Textured(3), 0.696069453104),
    (64, 48, Picture::Textured(0), Picture::Half, 0.645722435403),
    (64, 48, Picture::Textured(0), Picture::Inverted, -0.484104189493),
    (64, 48, Picture::Faint(0), Picture::Faint(3), 0.926811627873),
    (64, 48, Picture::Faint(0), Picture::Flat, 0.958031438999),
];

/// Render `a` of a photograph `b`.
fn shown(a: &[u8], b: &[u8], width: usize, height: usize) -> Pictures {
    let image = a.chunks_exact(3).map(|p| [p[0], p[1], p[2], 0].map(|v| f32::from(v) / 255.0)).collect();
    let target = b.chunks_exact(3).map(|p| u32::from_le_bytes([p[0], p[1], p[2], 255])).collect();
    Pictures { name: "table", width, height, image, target, bits: 8 }
}

#[test]
fn scores_and_training_loss_have_the_ssim_of_another_program() {
    for (width, height, a, b, want) in TABLE {
        let what = format!("{width}x{height} {a:?} {b:?}");
        let (a, b) = (a.bytes(width, height), b.bytes(width, height));
        let score = ssim(&a, &b, width, height).unwrap();
        assert!((score - want).abs() < 1e-10, "{what}: the score is {score}, not {want}");
        let floats = |p: &[u8]| -> Vec<[f64; 3]> {
            p.chunks_exact(3).map(|p| [p[0], p[1], p[2]].map(|v| f64::from(v) / 255.0)).collect()
        };
        let image: Vec<[f64; 4]> = floats(&a).into_iter().map(|[r, g, b]| [r, g, b, 0.0]).collect();
        let trained = loss(&image, &floats(&b), &vec![true; width * height], width, height, 0.2);
        assert!((trained.ssim - score).abs() < 1e-10, "{what}: the loss has {}, the score {score}", trained.ssim);
    }
}

#[test]
fn the_loss_on_the_device_has_the_ssim_of_another_program() {
    let Some(gpu) = common::gpu() else { return };
    for with in With::all(&gpu).into_iter().filter(|with| with.is_of_training()) {
        for (width, height, a, b, want) in TABLE {
            let (a, b) = (a.bytes(width, height), b.bytes(width, height));
            let (values, _) = on_device(&gpu, with, &shown(&a, &b, width, height), 0.2, None);
            let (got, score) = (f64::from(values[2]), ssim(&a, &b, width, height).unwrap());
            assert!(
                (got - want).abs() < 4e-6 && (got - score).abs() < 4e-6,
                "{width}x{height}: {got} instead of {want}"
            );
        }
    }
    common::assert_no_messages(&gpu);
}
