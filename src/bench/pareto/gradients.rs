//! Gradients of a model: time of forward and backward passes against their error.

use super::super::Error;
use super::pictures::milliseconds;
use super::{AGAIN, Reference, Setting, Table};
use crate::pass::counters;
use crate::raster::{self, GradientSum, ImageGradients, Planes, Renderer, Size, Target, Variants, Viewer};
use crate::vk::{Gpu, Memory};

/// Gradients of the first view of the reference by every variant that the device can run. All variants run in turn for
/// `rounds` timed rounds after an untimed one.
pub fn gradients(gpu: &Gpu, reference: &Reference, rounds: u32) -> Result<Table, Error> {
    let upstream = reference.upstream(0);
    let want = reference.gradients(0, &upstream).planes();
    let default = Variants::choose(gpu, false);
    let deterministic = Variants::choose(gpu, true);
    let mut forms = Variants::possible(gpu);
    let again = forms.len();
    forms.push(default);
    let mut runs = Vec::new();
    for form in &forms {
        runs.push(Run::new(gpu, reference, *form, &upstream)?);
    }
    let mut times = vec![Vec::new(); forms.len()];
    let mut errors = vec![(0.0, 0.0); forms.len()];
    for round in 0..=rounds {
        for (k, run) in runs.iter_mut().enumerate() {
            let (planes, ms) = run.once(gpu, reference)?;
            if round == 0 {
                errors[k] = compared(&planes, &want);
            } else {
                times[k].push(ms);
            }
        }
    }
    let mut table = Table {
        title: format!(
            "Gradients: one view, {} splats, a loss on {} pixels",
            reference.model.len(),
            reference.pixels.first().map_or(0, Vec::len)
        ),
        time: "least ms per view on the device, forward and backward".into(),
        error: "largest relative error of a plane of parameters (norm)".into(),
        same_error: (0.5, 1e-6),
        columns: vec!["1 - cosine".into()],
        settings: Vec::new(),
    };
    for (k, ((form, times), (error, cosine))) in forms.iter().zip(times).zip(errors).enumerate() {
        let mut name = if k == again { AGAIN.to_owned() } else { form.to_string() };
        if *form == deterministic && k != again {
            name += " (deterministic)";
        }
        table.settings.push(Setting {
            name,
            options: options(*form),
            default: *form == default && k != again,
            repeats: k == again,
            reproducible: form.gradients == GradientSum::Slots,
            time: super::least(times),
            error: Some(error),
            more: vec![cosine],
            dominated: false,
        });
    }
    table.mark();
    Ok(table)
}

fn options(form: Variants) -> String {
    let value = |v: serde_json::Value| v.as_str().map(str::to_owned).unwrap_or_default();
    let json = serde_json::to_value(form).unwrap_or_default();
    [("tile", "tile-shape"), ("gradients", "gradient-sum")]
        .iter()
        .map(|(key, option)| format!("--{option} {}", value(json[*key].clone())))
        .collect::<Vec<_>>()
        .join(" ")
}

/// A renderer with the buffers of a backward pass.
struct Run {
    variants: Variants,
    pairs: u32,
    model: Planes,
    grads: Planes,
    upstream: crate::vk::Buffer,
    held: Option<(Renderer, Target)>,
}

impl Run {
    fn new(gpu: &Gpu, reference: &Reference, variants: Variants, upstream: &[f32]) -> Result<Self, Error> {
        let n = reference.model.len() as u32;
        let buffer = gpu.buffer("grad_image", 4 * upstream.len() as u64, Memory::Device)?;
        gpu.write(&buffer, upstream)?;
        Ok(Self {
            variants,
            pairs: n.saturating_mul(4).max(1 << 16),
            model: Viewer::with_variants(gpu, variants).upload(&reference.model)?,
            grads: Planes::new(gpu, "g_", n)?,
            upstream: buffer,
            held: None,
        })
    }

    /// Gradients of the planes, and their time on the device in milliseconds.
    fn once(&mut self, gpu: &Gpu, reference: &Reference) -> Result<([Vec<f32>; 8], f64), Error> {
        let n = reference.model.len() as u32;
        let shot = &reference.shots[0];
        let (width, height) = (shot.camera.width, shot.camera.height);
        loop {
            if self.held.is_none() {
                let side = self.variants.tile.size();
                let size = Size {
                    clamp_gradient_passes: false,
                    ..Size::training(
                        n,
                        self.pairs.min(raster::most_pairs(gpu, self.variants)),
                        width.div_ceil(side) * height.div_ceil(side),
                    )
                };
                let target = Target::new(gpu, "pareto.", width * height, false)?;
                self.held = Some((Renderer::new(gpu, self.variants, size)?, target));
            }
            let Some((renderer, target)) = &self.held else { continue };
            let mut words = [0u32; counters::COUNT];
            words[counters::SPLATS] = n;
            let mut recorder = gpu.recorder("gradients")?;
            recorder.profile(true);
            recorder.upload(&renderer.counters, 0, bytemuck::cast_slice(&words))?;
            if self.variants.gradients != GradientSum::Slots
                && let Some(grad2d) = renderer.grad2d()
            {
                recorder.fill(grad2d, 0)?;
            }
            let lists = renderer.record_forward(&mut recorder, &self.model, shot, target, false)?;
            let of_image = ImageGradients { of_image: &self.upstream, of_aux: None };
            let gradients = raster::Gradients { model: &self.model, of_model: &self.grads, of_image };
            renderer.record_backward(&mut recorder, &lists, &gradients, shot, target)?;
            let ticket = recorder.submit()?;
            let ms = milliseconds(gpu, ticket)?;
            let words: Vec<u32> = gpu.read_at(&renderer.counters, 0, counters::COUNT)?;
            if words[counters::STATUS] & counters::PAIRS_BIT == 0 {
                return Ok((self.grads.read(gpu, n)?, ms));
            }
            let wanted = words[counters::PAIRS];
            if wanted <= self.pairs || self.pairs >= raster::most_pairs(gpu, self.variants) {
                return Err(Error::NotLive(format!("{wanted} (splat, tile) pairs do not fit the device's buffers")));
            }
            self.pairs = wanted.saturating_add(wanted / 8);
            self.held = None;
        }
    }
}

/// The largest relative error of a plane (by norm), and 1 - cosine over all planes, each plane divided by its norm.
fn compared(got: &[Vec<f32>; 8], want: &[Vec<f64>; 8]) -> (f64, f64) {
    let (mut worst, mut cosine, mut planes) = (0.0f64, 0.0, 0.0);
    for (got, want) in got.iter().zip(want) {
        let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
        let of_want = norm(&mut want.iter().copied());
        if of_want == 0.0 {
            continue;
        }
        let of_got = norm(&mut got.iter().map(|v| f64::from(*v)));
        let off = norm(&mut got.iter().zip(want).map(|(g, w)| f64::from(*g) - w));
        let dot: f64 = got.iter().zip(want).map(|(g, w)| f64::from(*g) * w).sum();
        worst = worst.max(off / of_want);
        cosine += dot / (of_got * of_want).max(f64::MIN_POSITIVE);
        planes += 1.0;
    }
    (worst, 1.0 - cosine / f64::max(planes, 1.0))
}
