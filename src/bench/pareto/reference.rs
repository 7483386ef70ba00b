//! The reference: views of a model, with some pixels of each by the brute-force renderer in double precision.

use rayon::prelude::*;

use super::super::Error;
use crate::pass::camera::{NEAR, Projection};
use crate::raster::RenderView;
use crate::scene::{Camera, Gaussians};
use crate::twin::reference::{self, Gradients, Image, ImageGradient, Settings};
use crate::twin::splat::Splat;

/// Pixels this close to a decision that rounding may turn over are left out. In units of the decision's condition: 16
/// roundings to f32.
const BAND: f64 = 16.0 / (1u64 << 24) as f64;

/// Some pixels of some views of a model, in double precision.
pub struct Reference {
    /// The model.
    pub model: Gaussians,
    splats: Vec<Splat<f64>>,
    /// The views.
    pub shots: Vec<RenderView>,
    settings: Settings,
    /// Compared pixels of each view, none near a decision.
    pub pixels: Vec<Vec<usize>>,
    /// Reference images at the compared pixels.
    pub images: Vec<Image>,
    /// Pixels left out because a decision is close.
    pub left_out: usize,
}

impl Reference {
    /// A reference of `pixels` pixels of every view, spread evenly.
    pub fn new(model: Gaussians, cameras: &[Camera], sh_degree: u32, pixels: usize) -> Result<Self, Error> {
        let background = [0.0f32; 3];
        let projection = Projection {
            sh_degree,
            near: NEAR,
            antialias: false,
            reference_clamp: false,
            black_learns: false,
            orthographic: false,
            limits: None,
            alpha_cutoff: None,
        };
        // The device gets cameras in f32.
        let shots: Vec<RenderView> =
            cameras.iter().map(|camera| RenderView { camera: rounded(camera), projection, background }).collect();
        let settings = Settings {
            sh_degree,
            near: f64::from(NEAR as f32),
            antialias: false,
            background: [0.0; 3],
            ..Settings::default()
        };
        let splats = Splat::all(&model);
        let looked: Vec<(Vec<usize>, Image)> = shots
            .par_iter()
            .map(|shot| {
                let all = shot.camera.width as usize * shot.camera.height as usize;
                let count = pixels.min(all);
                // A stride that visits all columns.
                let chosen: Vec<usize> = (0..count).map(|k| (k as u64 * 2_654_435_761 % all as u64) as usize).collect();
                let image = reference::render_at(&splats, &shot.camera, &settings, &chosen);
                (chosen, image)
            })
            .collect();
        let mut out = Self { model, splats, shots, settings, pixels: Vec::new(), images: Vec::new(), left_out: 0 };
        for (chosen, image) in looked {
            let kept: Vec<usize> = (0..chosen.len()).filter(|i| image.margin[*i] > BAND).collect();
            out.left_out += chosen.len() - kept.len();
            out.pixels.push(kept.iter().map(|i| chosen[*i]).collect());
            out.images.push(Image {
                colour: kept.iter().map(|i| image.colour[*i]).collect(),
                transmittance: kept.iter().map(|i| image.transmittance[*i]).collect(),
                depth: kept.iter().map(|i| image.depth[*i]).collect(),
                normal: kept.iter().map(|i| image.normal[*i]).collect(),
                blended: kept.iter().map(|i| image.blended[*i]).collect(),
                margin: kept.iter().map(|i| image.margin[*i]).collect(),
            });
        }
        let blended: u32 = out.images.iter().flat_map(|image| &image.blended).sum();
        if blended == 0 {
            return Err(Error::NotLive("not one splat shows in the pixels that are compared".into()));
        }
        Ok(out)
    }

    /// Number of compared pixels of all views.
    pub fn compared(&self) -> usize {
        self.pixels.iter().map(Vec::len).sum()
    }

    /// Largest and mean error of a view's compared pixels over pixels and channels, and the number of compared values.
    pub fn errors(&self, view: usize, rgbt: &[f32]) -> (f64, f64, usize) {
        let (mut largest, mut sum) = (0.0f64, 0.0);
        for (&pixel, want) in self.pixels[view].iter().zip(&self.images[view].colour) {
            for (k, want) in want.iter().enumerate() {
                let error = (f64::from(rgbt[4 * pixel + k]) - want).abs();
                largest = if error.is_nan() { f64::INFINITY } else { largest.max(error) };
                sum += error;
            }
        }
        (largest, sum, 3 * self.pixels[view].len())
    }

    /// Gradient of a loss by a view's image as (r, g, b, transmittance) per pixel, zero except at the compared pixels.
    /// Its values come from a counter.
    pub fn upstream(&self, view: usize) -> Vec<f32> {
        let camera = &self.shots[view].camera;
        let mut out = vec![0.0; 4 * camera.width as usize * camera.height as usize];
        for (k, &pixel) in self.pixels[view].iter().enumerate() {
            for c in 0..3 {
                let word = (3 * k + c) as u32;
                let mixed = word.wrapping_mul(0x9e37_79b9) ^ (word.wrapping_mul(0x85eb_ca6b) >> 13);
                out[4 * pixel + c] = (mixed >> 8) as f32 / (1u32 << 23) as f32 - 1.0;
            }
        }
        out
    }

    /// The gradients of the model for the image gradient `upstream`.
    pub fn gradients(&self, view: usize, upstream: &[f32]) -> Gradients {
        let pixels = &self.pixels[view];
        let mut g = ImageGradient::zeros(pixels.len());
        for (colour, &pixel) in g.colour.iter_mut().zip(pixels) {
            *colour = [0, 1, 2].map(|c| f64::from(upstream[4 * pixel + c]));
        }
        reference::backward_at(&self.splats, &self.shots[view].camera, &self.settings, &g, pixels)
    }
}

/// The camera with every number rounded to f32, as on the device.
fn rounded(camera: &Camera) -> Camera {
    let round = |v: f64| f64::from(v as f32);
    let mut out = *camera;
    for v in [&mut out.fx, &mut out.fy, &mut out.cx, &mut out.cy] {
        *v = round(*v);
    }
    out.rotation = out.rotation.map(|row| row.map(round));
    out.translation = out.translation.map(round);
    out
}
