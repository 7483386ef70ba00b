//! Single renders: time on the device against the error of colours.

use super::super::Error;
use super::{AGAIN, Reference, Setting, Table};
use crate::raster::tiles::DEPTH_BITS;
use crate::raster::{Picture, Planes, RenderView, ShStorage, TileShape, Variants, Viewer};
use crate::vk::{self, Gpu};

/// A way to render.
struct DrawingForm {
    name: String,
    options: String,
    variants: Variants,
    depth_bits: u32,
    sh_degree: u32,
    sh: ShStorage,
}

/// Every variant that the device can run, and the default with less precision or fewer terms.
fn forms(gpu: &Gpu, sh_degree: u32) -> Vec<DrawingForm> {
    let variants = Variants::choose(gpu, false);
    let plain = |name: String, variants| DrawingForm {
        name,
        options: String::new(),
        variants,
        depth_bits: DEPTH_BITS,
        sh_degree,
        sh: ShStorage::Full,
    };
    let mut all = vec![plain("default".into(), variants)];
    for (tile, name, options) in [
        (TileShape::Column, "tiles of 8x8, a thread per column", "--tile-shape column"),
        (TileShape::Pixel, "tiles of 16x16, a thread per pixel", "--tile-shape pixel"),
    ] {
        if tile != variants.tile {
            all.push(DrawingForm { options: options.into(), ..plain(name.into(), Variants { tile, ..variants }) });
        }
    }
    for bits in [24, 16, 12] {
        all.push(DrawingForm { depth_bits: bits, ..plain(format!("depths sorted by {bits} bits"), variants) });
    }
    all.push(DrawingForm {
        sh: ShStorage::Half,
        options: "--sh-bits 16".into(),
        ..plain("spherical harmonics of 16 bits".into(), variants)
    });
    for degree in 0..sh_degree {
        all.push(DrawingForm {
            sh_degree: degree,
            ..plain(format!("spherical harmonics to degree {degree}"), variants)
        });
    }
    all.push(plain(AGAIN.into(), variants));
    all
}

/// Renders every view of the reference in every way. All ways run in turn for `rounds` timed rounds after an untimed
/// one.
pub fn pictures(gpu: &Gpu, reference: &Reference, rounds: u32) -> Result<Table, Error> {
    let sh_degree = reference.shots.iter().map(|shot| shot.projection.sh_degree).max().unwrap_or(0);
    let forms = forms(gpu, sh_degree);
    let mut drawers: Vec<(Viewer, Planes)> = Vec::new();
    for form in &forms {
        let mut viewer = Viewer::with_variants(gpu, form.variants);
        viewer.sort_depths_by(form.depth_bits);
        let planes = viewer.upload_with(&reference.model, form.sh)?;
        drawers.push((viewer, planes));
    }
    let mut times = vec![Vec::new(); forms.len()];
    let mut errors = vec![(0.0f64, 0.0, 0usize); forms.len()];
    for round in 0..=rounds {
        for (k, form) in forms.iter().enumerate() {
            let mut sum = 0.0;
            for (view, shot) in reference.shots.iter().enumerate() {
                let mut shot = *shot;
                shot.projection.sh_degree = form.sh_degree;
                let (viewer, planes) = &mut drawers[k];
                let (picture, ms) = timed(gpu, viewer, planes, reference.model.len() as u32, &shot)?;
                sum += ms;
                if round == 0 {
                    let (largest, total, values) = reference.errors(view, &picture.rgbt);
                    let error = &mut errors[k];
                    *error = (error.0.max(largest), error.1 + total, error.2 + values);
                }
            }
            if round > 0 {
                times[k].push(sum / reference.shots.len() as f64);
            }
        }
    }
    let mut table = Table {
        title: format!(
            "Pictures: {} views, {} splats, {} pixels compared, {} near a decision left out",
            reference.shots.len(),
            reference.model.len(),
            reference.compared(),
            reference.left_out
        ),
        time: "least ms per picture on the device".into(),
        error: "largest error of a colour".into(),
        // An error below a hundredth of an 8-bit step counts as none.
        same_error: (0.1, 0.01 / 255.0),
        columns: vec!["mean error".into()],
        settings: Vec::new(),
    };
    for ((form, times), (largest, total, values)) in forms.into_iter().zip(times).zip(errors) {
        table.settings.push(Setting {
            default: form.name == "default",
            repeats: form.name == AGAIN,
            reproducible: true,
            name: form.name,
            options: form.options,
            time: super::least(times),
            error: Some(largest),
            more: vec![total / values.max(1) as f64],
            dominated: false,
        });
    }
    table.mark();
    Ok(table)
}

/// A render, and the time of its passes on the device in milliseconds.
fn timed(
    gpu: &Gpu,
    viewer: &mut Viewer,
    planes: &Planes,
    splats: u32,
    shot: &RenderView,
) -> Result<(Picture, f64), Error> {
    loop {
        let mut recorder = gpu.recorder("picture")?;
        recorder.profile(true);
        viewer.record(&mut recorder, planes, splats, shot, false)?;
        let ticket = recorder.submit()?;
        if let Some(picture) = viewer.collect()? {
            return Ok((picture, milliseconds(gpu, ticket)?));
        }
    }
}

/// Time of a submission on the device.
pub(super) fn milliseconds(gpu: &Gpu, ticket: vk::Ticket) -> Result<f64, Error> {
    gpu.wait(ticket)?;
    let passes = gpu.timings(ticket)?.unwrap_or_default();
    Ok(passes.iter().map(|pass| pass.ns).sum::<f64>() / 1e6)
}
