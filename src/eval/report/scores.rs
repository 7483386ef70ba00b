//! The numbers of a report: tiles at the top, the run's, and a row for each held-out view.

use super::row;
use super::text::{bytes, decibels, duration};
use crate::eval::Metrics;
use crate::format::markup::escape;
use crate::numbers::{counted, fraction, grouped, percent, signed, steps_and_looks};

/// Whether the numbers are of a training, and not of the scoring of a finished model.
pub(super) fn trained(m: &Metrics) -> bool {
    m.iterations > 0
}

pub(super) fn tiles(m: &Metrics) -> String {
    let ssim = m.ssim.map_or_else(|| "\u{2013}".into(), |s| fraction(s, 3));
    let per_step =
        if trained(m) { format!("{} a step", duration(m.seconds_per_iteration)) } else { "to score".to_owned() };
    let held_out = format!("mean of {}", counted(m.test_images, "held-out view"));
    let lpips = m.lpips_squeeze.map(|v| ("LPIPS", format!("{v:.3}"), "", "on SqueezeNet, 0 is identical"));
    // The model's own colours first: an exposure belongs to a photograph, and no viewer of the model shows it.
    let own = m.exposures.and_then(|exposures| exposures.psnr_own_colours);
    let (psnr, exposed) = match own {
        Some(own) => (own, Some(("PSNR, exposed", decibels(m.psnr), "dB", "as each photograph is exposed"))),
        None => (m.psnr.unwrap_or(f64::NAN), None),
    };
    let psnr = Some(psnr).filter(|psnr| !psnr.is_nan());
    let own_colours = format!("{held_out}, in the model's own colours");
    let detail = if own.is_some() { &own_colours } else { &held_out };
    [
        Some(("PSNR", decibels(psnr), "dB", detail.as_str())),
        exposed,
        Some(("SSIM", ssim, "", "1 is identical")),
        lpips,
        Some(("Splats", grouped(m.splats as u64), "", bytes(m.bytes).as_str())),
        Some(("Time", duration(m.seconds), "", per_step.as_str())),
    ]
    .into_iter()
    .flatten()
    .map(|(name, value, unit, detail)| {
        format!(
            "<div class=\"tile\"><dt>{name}</dt><dd><span class=\"value\">{value}</span> \
             <span class=\"unit\">{unit}</span><span class=\"detail\">{detail}</span></dd></div>"
        )
    })
    .collect()
}

pub(super) fn numbers(m: &Metrics) -> String {
    let optional = |v: Option<u64>| v.map_or_else(|| "not known".into(), bytes);
    let geometry = m.geometry.rows();
    let lpips = m.lpips_squeeze.map(|v| ("LPIPS on SqueezeNet", format!("{v:.4}")));
    let seen = m.psnr_seen.zip(m.seen).map(|(psnr, seen)| {
        ("PSNR of what is seen", format!("{} dB, {} of the pixels", decibels(Some(psnr)), percent(seen, 1)))
    });
    let own = m.exposures.and_then(|e| e.psnr_own_colours);
    let own = own.map(|psnr| ("PSNR, the model's own colours", format!("{} dB", decibels(Some(psnr)))));
    let heart = m.fitted_by_heart();
    let trained_on = [
        m.psnr_training.map(|psnr| ("PSNR, photographs trained on", format!("{} dB", decibels(Some(psnr))))),
        m.ssim_training.map(|ssim| ("SSIM, photographs trained on", fraction(ssim, 4))),
        heart.map(|more| ("fitted by heart", format!("{} dB over held-out photographs", signed(more, 2)))),
    ];
    let of_training = ["method", "iterations", "training images", "seed", "time per step"];
    [
        ("method", m.method.clone()),
        ("iterations", steps_and_looks(m.iterations, m.train_images)),
        ("scene", m.scene.clone()),
        ("training images", m.train_images.to_string()),
        ("held-out images", m.test_images.to_string()),
        ("size", format!("{} \u{d7} {} px", m.width, m.height)),
        ("seed", m.seed.to_string()),
        ("device", m.device.clone()),
        (if own.is_some() { "PSNR, exposed" } else { "PSNR" }, format!("{} dB", decibels(m.psnr))),
        ("PSNR, colours fitted", format!("{} dB", decibels(m.psnr_cc))),
        ("SSIM", m.ssim.map_or_else(|| "\u{2013}".into(), |s| fraction(s, 4))),
        ("splats", grouped(m.splats as u64)),
        ("model file", bytes(m.bytes)),
        ("total time", duration(m.seconds)),
        ("time per step", duration(m.seconds_per_iteration)),
        ("peak device memory", bytes(m.peak_device_bytes)),
        ("peak host memory", optional(m.peak_host_bytes)),
    ]
    .iter()
    .chain(trained_on.iter().flatten())
    .chain(&seen)
    .chain(&own)
    .chain(&lpips)
    .chain(&geometry)
    .filter(|(k, _)| trained(m) || !of_training.contains(k))
    .map(|(k, v)| row(k, v))
    .collect()
}

pub(super) fn scores(m: &Metrics) -> String {
    if m.images.is_empty() {
        return String::new();
    }
    let finite = || m.images.iter().map(|i| i.psnr).filter(|p| p.is_finite());
    let (low, high) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
    let with_lpips = m.images.iter().any(|i| i.lpips_squeeze.is_some());
    let body: String = m
        .images
        .iter()
        .map(|i| {
            // Bars start one decibel below the worst view, so that it has one too.
            let share = ((i.psnr - low + 1.0) / (high - low + 1.0)).clamp(0.0, 1.0) * 100.0;
            let share = if share.is_nan() { 100.0 } else { share };
            format!(
                "<tr><th scope=\"row\">{}</th><td class=\"number\">{}</td><td class=\"bar\" aria-hidden=\"true\">\
                 <span style=\"width:{share:.1}%\"></span></td><td class=\"number\">{}</td><td \
                 class=\"number\">{:.4}</td>{}</tr>",
                escape(&i.name),
                decibels(Some(i.psnr)),
                decibels(Some(i.psnr_cc).filter(|p| !p.is_nan())),
                i.ssim,
                if with_lpips { lpips_cell(i.lpips_squeeze) } else { String::new() }
            )
        })
        .collect();
    let lpips = if with_lpips { "<th scope=\"col\" class=\"number\">LPIPS</th>" } else { "" };
    format!(
        "<table class=\"scores\"><caption>Each held-out view</caption><thead><tr><th scope=\"col\">View</th>\
         <th scope=\"col\" class=\"number\">PSNR, dB</th><td class=\"bar\"></td>\
         <th scope=\"col\" class=\"number\">colours fitted</th>\
         <th scope=\"col\" class=\"number\">SSIM</th>{lpips}</tr></thead><tbody>{body}</tbody></table>"
    )
}

fn lpips_cell(value: Option<f64>) -> String {
    let value = value.map_or_else(|| "\u{2013}".into(), |v| format!("{v:.4}"));
    format!("<td class=\"number\">{value}</td>")
}
