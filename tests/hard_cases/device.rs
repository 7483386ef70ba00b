//! A model seen by one camera: on the device, and in f64 by the brute-force renderer.

use psrgs_vk::pass::camera::{NEAR, Projection};
use psrgs_vk::pass::counters;
use psrgs_vk::raster::{self, Planes, RenderView, Renderer, Size, Target, Variants, Viewer};
use psrgs_vk::scene::random::Random;
use psrgs_vk::scene::{Camera, Gaussians};
use psrgs_vk::twin::reference::{self, Gradients, Image, ImageGradient, Settings};
use psrgs_vk::twin::splat::Splat;
use psrgs_vk::vk::{Gpu, Memory};

use super::common::guards::Guards;
use super::common::splats::{rounded, to_scene, vector};

/// Pixels nearer than this to a decision are left out: 16 roundings to f32, in units of the decision's condition.
pub(crate) const BAND: f64 = 16.0 / (1u64 << 24) as f64;
pub(crate) const ROWS: [usize; 8] = [3, 4, 3, 1, 12, 12, 12, 12];
pub(crate) const NAMES: [&str; 8] = ["means", "quats", "scales", "opacities", "sh0", "sh1", "sh2", "sh3"];
pub(crate) const MEANS: usize = 0;
pub(crate) const QUATS: usize = 1;
pub(crate) const SCALES: usize = 2;
pub(crate) const OPACITIES: usize = 3;
pub(crate) const SH0: usize = 4;

/// A model and a camera, as the device gets them, and both in f64.
pub(crate) struct Scene {
    pub(crate) model: Gaussians,
    pub(crate) shot: RenderView,
    pub(crate) splats: Vec<Splat<f64>>,
    settings: Settings,
    pub(crate) clamp_gradient_passes: bool,
}

/// Results of a forward and a backward pass on the device.
pub(crate) struct Backward {
    /// Gradients of the planes.
    pub(crate) planes: [Vec<f32>; 8],
    /// Evaluated and blended pixel-splats of the forward pass, and of the backward pass.
    pub(crate) pairs: [u32; 4],
    pub(crate) counters: Vec<u32>,
}

/// A camera at the origin that looks along z.
pub(crate) fn straight(width: u32, height: u32) -> Camera {
    let (w, h) = (f64::from(width), f64::from(height));
    Camera {
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        translation: [0.0; 3],
        fx: 0.9 * w,
        fy: 0.9 * w,
        cx: 0.5 * w,
        cy: 0.5 * h,
        width,
        height,
    }
}

/// A round splat of deviation `sigma` pixels seen at pixel position `at` and depth `z`, with a colour of its own.
pub(crate) fn round(
    random: &mut Random,
    camera: &Camera,
    at: [f64; 2],
    z: f64,
    sigma: f64,
    opacity: f64,
) -> Splat<f64> {
    let point = [(at[0] - camera.cx) / camera.fx * z, (at[1] - camera.cy) / camera.fy * z, z];
    Splat {
        mean: to_scene(camera, point),
        quat: [1.0, 0.0, 0.0, 0.0],
        log_scale: [(sigma * z / camera.fx).ln(); 3],
        logit: (opacity / (1.0 - opacity)).ln(),
        sh: std::array::from_fn(|k| vector(random).map(|v| if k == 0 { 1.0 + 0.5 * v } else { 0.1 * v })),
    }
}

impl Scene {
    pub(crate) fn new(splats: &[Splat<f64>], camera: Camera, antialias: bool) -> Self {
        let mut model = Gaussians::zeros(splats.len());
        for (i, splat) in splats.iter().enumerate() {
            splat.store(&mut model, i);
        }
        let background = [0.25f32, 0.5, 0.75];
        let projection = Projection {
            sh_degree: 3,
            near: NEAR,
            antialias,
            reference_clamp: false,
            black_learns: false,
            orthographic: false,
            limits: None,
            alpha_cutoff: None,
        };
        let near = f64::from(NEAR as f32);
        Self {
            splats: Splat::all(&model),
            model,
            shot: RenderView { camera: rounded(camera), projection, background },
            settings: Settings {
                sh_degree: 3,
                near,
                antialias,
                background: background.map(f64::from),
                ..Settings::default()
            },
            clamp_gradient_passes: false,
        }
    }

    pub(crate) fn pixels(&self) -> usize {
        (self.shot.camera.width * self.shot.camera.height) as usize
    }

    /// The picture in f64.
    pub(crate) fn wanted(&self) -> Image {
        reference::render(&self.splats, &self.shot.camera, &self.settings)
    }

    /// Gradients in f64.
    pub(crate) fn wanted_gradients(&self, upstream: &[f32]) -> Gradients {
        let mut g = ImageGradient::zeros(self.pixels());
        for (i, values) in upstream.chunks_exact(4).enumerate() {
            g.colour[i] = std::array::from_fn(|c| f64::from(values[c]));
            g.transmittance[i] = f64::from(values[3]);
        }
        reference::backward(&self.splats, &self.shot.camera, &self.settings, &g)
    }

    /// The sums over pixels of the absolute contributions to the f64 gradients. Errors of sums that cancel are small
    /// against them.
    pub(crate) fn contributions(&self, upstream: &[f32]) -> [Vec<f64>; 8] {
        let mut sums = ROWS.map(|row| vec![0.0; row * self.splats.len()]);
        for pixel in 0..self.pixels() {
            let mut alone = vec![0.0; upstream.len()];
            alone[4 * pixel..4 * pixel + 4].copy_from_slice(&upstream[4 * pixel..4 * pixel + 4]);
            for (sums, plane) in sums.iter_mut().zip(self.wanted_gradients(&alone).planes()) {
                sums.iter_mut().zip(plane).for_each(|(sum, value)| *sum += value.abs());
            }
        }
        sums
    }

    /// The device's picture: red, green, blue and transmittance of each pixel.
    pub(crate) fn picture(&self, gpu: &Gpu, variants: Variants) -> Vec<f32> {
        let mut viewer = Viewer::with_variants(gpu, variants);
        let planes = viewer.upload(&self.model).unwrap();
        viewer.render(&planes, self.model.len() as u32, &self.shot, false).unwrap().rgbt
    }

    /// The device's gradients for an upstream gradient of 4 floats per pixel.
    pub(crate) fn gradients(&self, gpu: &Gpu, variants: Variants, upstream: &[f32]) -> Backward {
        let n = self.model.len() as u32;
        let (width, height) = (self.shot.camera.width, self.shot.camera.height);
        let side = variants.tile.size();
        let tiles = width.div_ceil(side) * height.div_ceil(side);
        let size = Size {
            count: true,
            clamp_gradient_passes: self.clamp_gradient_passes,
            ..Size::training(n, n * tiles, tiles)
        };
        let renderer = Renderer::new(gpu, variants, size).unwrap();
        let (model, grads) = (Planes::new(gpu, "", n).unwrap(), Planes::new(gpu, "g_", n).unwrap());
        let target = Target::new(gpu, "", width * height, false).unwrap();
        let of_image = gpu.buffer("grad_image", 4 * upstream.len() as u64, Memory::Device).unwrap();
        model.write(gpu, &self.model).unwrap();
        gpu.write(&of_image, upstream).unwrap();
        let mut words = [0u32; counters::COUNT];
        words[counters::SPLATS] = n;
        let mut rec = gpu.recorder("forward and backward").unwrap();
        rec.upload(&renderer.counters, 0, bytemuck::cast_slice(&words)).unwrap();
        rec.fill(renderer.pair_counts(), 0).unwrap();
        for buffer in grads.buffers() {
            rec.fill(buffer, f32::NAN.to_bits()).unwrap();
        }
        let lists = renderer.record_forward(&mut rec, &model, &self.shot, &target, false).unwrap();
        let of_image = raster::ImageGradients { of_image: &of_image, of_aux: None };
        let gradients = raster::Gradients { model: &model, of_model: &grads, of_image };
        renderer.record_backward(&mut rec, &lists, &gradients, &self.shot, &target).unwrap();
        rec.submit().unwrap();
        let counters: Vec<u32> = gpu.read(&renderer.counters).unwrap();
        assert_eq!(counters[counters::STATUS], 0, "the pairs were meant to fit: {}", counters[counters::PAIRS]);
        let pairs: Vec<u32> = gpu.read(renderer.pair_counts()).unwrap();
        Backward { planes: grads.read(gpu, n).unwrap(), pairs: [pairs[0], pairs[1], pairs[2], pairs[3]], counters }
    }
}

/// Which pixels are away from every decision. Panics where a share of more than `most_left_out` is not.
pub(crate) fn decided(what: &str, image: &Image, most_left_out: f64) -> Vec<bool> {
    let decided: Vec<bool> = image.margin.iter().map(|m| *m > BAND).collect();
    let left_out = decided.iter().filter(|d| !**d).count();
    let share = left_out as f64 / decided.len() as f64;
    assert!(share <= most_left_out, "{what}: {left_out} of {} pixels are near a decision", decided.len());
    decided
}

/// The largest error of colour and transmittance over the decided pixels.
pub(crate) fn worst(image: &Image, decided: &[bool], got: &[f32]) -> f64 {
    let mut worst = 0.0f64;
    for i in (0..decided.len()).filter(|i| decided[*i]) {
        let [r, g, b] = image.colour[i];
        for (c, want) in [r, g, b, image.transmittance[i]].into_iter().enumerate() {
            let error = (f64::from(got[4 * i + c]) - want).abs();
            worst = if error.is_nan() { f64::INFINITY } else { worst.max(error) };
        }
    }
    worst
}

/// A random gradient of every decided pixel, zero elsewhere.
pub(crate) fn upstream(random: &mut Random, decided: &[bool]) -> Vec<f32> {
    decided.iter().flat_map(|d| [0; 4].map(|_| if *d { random.symmetric() as f32 } else { 0.0 })).collect()
}

/// |got - want| / |want| of a plane.
pub(crate) fn relative(got: &[f32], want: &[f64]) -> f64 {
    let square = |sum: f64, v: f64| sum + v * v;
    let error = got.iter().zip(want).map(|(g, w)| f64::from(*g) - w).fold(0.0, square).sqrt();
    error / want.iter().copied().fold(0.0, square).sqrt().max(1e-300)
}

/// Whole planes against the reference: no element is off by more than `bound` of itself,
/// or of a thousandth of the plane's largest.
pub(crate) fn check(what: &str, planes: &[usize], got: &[Vec<f32>; 8], want: &[Vec<f64>; 8], bound: f64) {
    for &p in planes {
        let name = format!("{what}, {}", NAMES[p]);
        Guards { floor: 1e-3, ..Guards::of(bound) }.check(&name, got[p].len(), &got[p], &want[p]);
    }
}

/// Whole planes against the reference: no element is off by more than `bound` of its contributions.
pub(crate) fn check_sums(
    what: &str,
    planes: &[usize],
    got: &[Vec<f32>; 8],
    (want, contributions): (&[Vec<f64>; 8], &[Vec<f64>; 8]),
    bound: f64,
) {
    for &p in planes {
        for (i, ((got, want), size)) in got[p].iter().zip(&want[p]).zip(&contributions[p]).enumerate() {
            let off = (f64::from(*got) - want).abs();
            assert!(
                off <= bound * size,
                "{what}, {}: element {i} is {got:e} instead of {want:e}, of contributions of {size:e}",
                NAMES[p]
            );
        }
    }
}

/// Panics where a number is not finite.
pub(crate) fn assert_finite(what: &str, planes: &[Vec<f32>; 8]) {
    for (plane, name) in planes.iter().zip(NAMES) {
        let bad = plane.iter().position(|v| !v.is_finite());
        assert!(bad.is_none(), "{what}: element {bad:?} of {name} is not finite");
    }
}
