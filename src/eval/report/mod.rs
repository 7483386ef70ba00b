//! The report of a run: one HTML file that needs nothing else, with curves, numbers and pictures.

mod chart;
mod interactive;
mod limit;
mod panel;
mod scores;
mod text;
mod training;

pub use interactive::Interactive;
pub use limit::REPORT_BYTES;
pub(crate) use panel::depth as painted_depth;

use std::fmt::Write;
use std::path::Path;

use image::RgbImage;

use super::colormap::Colormap;
use super::{ImageScore, Metrics};
use crate::format::atomic;
use crate::format::markup::{base64, escape, fill};
use crate::numbers::{counted, fraction, grouped};
use panel::{STORAGES, Storage};
use scores::{numbers, scores, tiles, trained};
use text::{decibels, link, significant};

/// Largest size of the pictures and the model on a page, as data addresses, bytes.
const PICTURE_BUDGET: usize = 18_000_000;

/// Where a page's own content may come from, and what the viewer of a model needs besides: parts of the page that a
/// script unpacked.
const POLICY: &str = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'";
const POLICY_WITH_MODEL: &str = "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src \
    'unsafe-inline' blob:; connect-src data: blob:; worker-src blob:; base-uri 'none'; form-action 'none'";

/// A quantity over the training steps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// The quantity.
    pub name: String,
    /// Its unit, may be empty.
    pub unit: String,
    /// Step and value, by ascending step.
    pub points: Vec<(f64, f64)>,
    /// How it is drawn.
    pub form: CurveForm,
}

/// How the values of a curve go together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CurveForm {
    /// One value goes over into the next: a line.
    #[default]
    Line,
    /// A value holds until the next: a line in steps.
    Steps,
    /// Neighbouring values are of different things, a photograph each, say: dots, which no line joins.
    Dots,
}

/// Depth (z in the camera frame, dataset units), row-major; 0 or not finite where there is no surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DepthMap {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width * height` values.
    pub values: Vec<f32>,
}

/// A held-out view.
#[derive(Clone, Debug)]
pub struct ViewPanel {
    /// Name of the photograph.
    pub name: String,
    /// The photograph at the size it was compared at.
    pub photograph: RgbImage,
    /// The render, of the same size.
    pub render: RgbImage,
    /// Depth of the render.
    pub depth: Option<DepthMap>,
    /// Which pixels have a part in the scores, row-major; empty where all have.
    pub counting: Vec<bool>,
    /// The stages of the training, where it had some.
    pub stages: Option<StagePanel>,
    /// PSNR in decibels.
    pub psnr: f64,
    /// PSNR in decibels after a colour fit.
    pub psnr_cc: f64,
    /// SSIM.
    pub ssim: f64,
    /// LPIPS on SqueezeNet.
    pub lpips_squeeze: Option<f64>,
    /// Gradient magnitude similarity deviation.
    pub gmsd: Option<f64>,
    /// PSNR in decibels where the photograph has high frequencies.
    pub psnr_high_frequency: Option<f64>,
}

/// Renders of a view by the stages of a training, at the size of its photograph.
#[derive(Clone, Debug)]
pub struct StagePanel {
    /// Which pixels are texture.
    pub mask: RgbImage,
    /// The splats that were there at the end of the low-frequency stage, alone.
    pub low: RgbImage,
    /// The splats that came after, alone.
    pub high: RgbImage,
}

impl StagePanel {
    fn pictures(&self) -> [(&'static str, &'static str, &RgbImage); 3] {
        [
            ("mask", "Texture mask", &self.mask),
            ("low", "Low frequencies", &self.low),
            ("high", "High frequencies", &self.high),
        ]
    }
}

/// Everything a report shows.
#[derive(Clone, Debug)]
pub struct ReportData {
    /// Heading of the page.
    pub title: String,
    /// Settings by name.
    pub settings: Vec<(String, String)>,
    /// Curves, drawn in this order.
    pub curves: Vec<Curve>,
    /// The numbers of the run. With no iterations they are those of a model that was only scored.
    pub metrics: Metrics,
    /// Held-out views, shown in this order.
    pub views: Vec<ViewPanel>,
    /// Files of the run: path relative to the report, and what it is.
    pub files: Vec<(String, String)>,
    /// A drawing in SVG that goes before the pictures, with its caption.
    pub drawing: Option<(String, String)>,
    /// Remarks, one paragraph each.
    pub notes: Vec<String>,
    /// The model to look around in.
    pub model: Option<Interactive>,
}

impl ViewPanel {
    /// The view's numbers.
    pub fn score(&self) -> ImageScore {
        let Self { psnr, psnr_cc, ssim, lpips_squeeze, gmsd, psnr_high_frequency, .. } = *self;
        ImageScore {
            name: self.name.clone(),
            psnr,
            psnr_seen: None,
            seen: None,
            psnr_cc,
            ssim,
            lpips_squeeze,
            gmsd,
            psnr_high_frequency,
        }
    }
}

/// Errors of making a report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// Photograph, render and depth of a view must have one size.
    #[error("view {name}: the {what} is {got:?} pixels, the photograph {expected:?}")]
    Size {
        /// Name of the view.
        name: String,
        /// Which picture.
        what: &'static str,
        /// Its size (for depth of a wrong length: the number of values and 1).
        got: (u32, u32),
        /// Size of the photograph.
        expected: (u32, u32),
    },
    /// A picture could not be encoded.
    #[error("cannot encode a picture: {0}")]
    Picture(#[from] image::ImageError),
    /// The page could not be written.
    #[error(transparent)]
    Write(#[from] crate::format::Error),
}

/// Writes the page to `path`.
pub fn write_report(data: &ReportData, path: &Path) -> Result<(), ReportError> {
    let page = render_report(data)?;
    Ok(atomic::write(path, |out| out.write_all(page.as_bytes()))?)
}

/// Whether a page that begins so is a report of this program; those of earlier versions name no generator.
pub fn is_report(page: &str) -> bool {
    let head = page.split("</head>").next().unwrap_or_default();
    let earlier =
        "content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'\"";
    head.contains("<meta name=\"generator\" content=\"psrgs-vk\">") || head.contains(earlier)
}

/// The page as text.
pub fn render_report(data: &ReportData) -> Result<String, ReportError> {
    for view in &data.views {
        check(view)?;
    }
    let m = &data.metrics;
    let of_model = data.model.as_ref().map_or(0, Interactive::bytes);
    let (views, shown) = views(&data.views, PICTURE_BUDGET - of_model)?;
    let mut notes: Vec<String> = data.notes.clone();
    if shown < data.views.len() {
        notes.push(format!(
            "Pictures of the first {shown} of {} are shown; the table has all of them.",
            counted(data.views.len(), "held-out view")
        ));
    }
    let notes: String = notes.iter().map(|n| format!("<p class=\"note\">{}</p>", escape(n))).collect();
    let steps = data.curves.iter().flat_map(|c| &c.points).map(|p| p.0).fold(f64::from(m.iterations), f64::max);
    let curves: String = data.curves.iter().enumerate().map(|(k, c)| chart::figure(c, k, steps)).collect();
    let settings: String = data.settings.iter().map(|(k, v)| row(k, v)).collect();
    let steps_done = if trained(m) { format!(", {} steps", grouped(u64::from(m.iterations))) } else { String::new() };
    let subtitle = format!("{} with {}{steps_done} on {}", escape(&m.scene), escape(&m.method), escape(&m.device));
    Ok(fill(
        include_str!("page.html"),
        &[
            ("title", &escape(&data.title)),
            ("subtitle", &subtitle),
            ("policy", if of_model > 0 { POLICY_WITH_MODEL } else { POLICY }),
            ("style", include_str!("page.css")),
            ("model", &data.model.as_ref().map_or_else(String::new, Interactive::section)),
            ("script", include_str!("page.js")),
            ("tiles", &tiles(m)),
            ("notes", &notes),
            ("drawing", &data.drawing.as_ref().map_or_else(String::new, drawing)),
            ("curves", &section("curves", "Training", "", "charts", &curves)),
            ("views", &section("views", "Held-out views", HINT, "views", &views)),
            ("numbers", &numbers(m)),
            ("scores", &scores(m)),
            ("training", &training::table(&m.training_photographs)),
            ("settings", &settings),
            ("files", &files(&data.files)),
        ],
    ))
}

fn check(view: &ViewPanel) -> Result<(), ReportError> {
    let expected = view.photograph.dimensions();
    let wrong = |what, got| Err(ReportError::Size { name: view.name.clone(), what, got, expected });
    if view.render.dimensions() != expected {
        return wrong("render", view.render.dimensions());
    }
    for (kind, _, picture) in view.stages.iter().flat_map(StagePanel::pictures) {
        if picture.dimensions() != expected {
            return wrong(kind, picture.dimensions());
        }
    }
    let pixels = expected.0 as usize * expected.1 as usize;
    if !view.counting.is_empty() && view.counting.len() != pixels {
        return wrong("mask", (view.counting.len() as u32, 1));
    }
    match &view.depth {
        Some(d) if (d.width, d.height) != expected => wrong("depth", (d.width, d.height)),
        Some(d) if d.values.len() as u64 != u64::from(d.width) * u64::from(d.height) => {
            wrong("depth", (d.values.len() as u32, 1))
        }
        _ => Ok(()),
    }
}

const HINT: &str = "<p class=\"hint\">Drag over a large picture, or focus it and use the arrow keys, to uncover what \
    lies under the photograph. Each of the others can be chosen for that by its name.</p>";

/// A drawing as a picture, so that nothing in it runs.
fn drawing((svg, caption): &(String, String)) -> String {
    let (data, caption) = (base64(svg.as_bytes()), escape(caption));
    let style = "style=\"max-width:100%\"";
    let picture = format!("<img {style} alt=\"{caption}\" src=\"data:image/svg+xml;base64,{data}\">");
    format!("<figure id=\"drawing\">{picture}<figcaption>{caption}</figcaption></figure>")
}

fn section(id: &str, heading: &str, intro: &str, class: &str, body: &str) -> String {
    if body.is_empty() {
        return String::new();
    }
    format!(
        "<section aria-labelledby=\"{id}\"><h2 id=\"{id}\">{heading}</h2>{intro}<div \
         class=\"{class}\">{body}</div></section>"
    )
}

fn row(name: &str, value: &str) -> String {
    format!("<tr><th scope=\"row\">{}</th><td>{}</td></tr>", escape(name), escape(value))
}

fn files(files: &[(String, String)]) -> String {
    if files.is_empty() {
        return String::new();
    }
    let items: String = files
        .iter()
        .map(|(path, what)| {
            // A path that begins like an address would leave the folder.
            let address = link(path);
            let address = address.trim_start_matches('/');
            format!("<li><a href=\"./{address}\">{}</a> {}</li>", escape(path), escape(what))
        })
        .collect();
    section("files", "Files", "", "files", &format!("<ul>{items}</ul>"))
}

/// The cards of all views that fit in `budget` bytes, and how many these are.
fn views(all: &[ViewPanel], budget: usize) -> Result<(String, usize), ReportError> {
    let differences: Vec<Vec<f32>> =
        all.iter().map(|v| panel::differences(&v.photograph, &v.render, &v.counting)).collect();
    // One scale for all views, so that they compare: most of the errors, at least a few 8-bit steps.
    let error_high = panel::quantile(differences.iter().flatten().copied(), 0.99).max(8.0).ceil();
    for storage in STORAGES {
        let last = Some(&storage) == STORAGES.last();
        let (mut out, mut shown) = (String::new(), 0);
        for (k, (view, errors)) in all.iter().zip(&differences).enumerate() {
            let card = card(view, errors, error_high, storage, k)?;
            if out.len() + card.len() > budget {
                break;
            }
            out.push_str(&card);
            shown += 1;
        }
        if shown == all.len() || last {
            return Ok((out, shown));
        }
    }
    Ok((String::new(), 0))
}

/// One view: a slider over photograph and another picture, and all pictures beside it. The script fills the slider from
/// the pictures, which are stored once.
fn card(
    view: &ViewPanel,
    errors: &[f32],
    error_high: f32,
    storage: Storage,
    number: usize,
) -> Result<String, ReportError> {
    let size = view.photograph.dimensions();
    let mut panels = String::new();
    let mut add = |kind: &str, title: &str, picture: &RgbImage, scale: &str| -> Result<(), ReportError> {
        let source = panel::address(picture, storage)?;
        let alt = format!("{title} of {}", view.name);
        let _ = write!(
            panels,
            "<figure class=\"panel\" data-kind=\"{kind}\"><img src=\"{source}\" alt=\"{}\" width=\"{}\" \
             height=\"{}\"><figcaption><span class=\"title\">{title}</span>{scale}</figcaption></figure>",
            escape(&alt),
            size.0,
            size.1
        );
        Ok(())
    };
    add("photograph", "Photograph", &panel::hatched(&view.photograph, &view.counting), "")?;
    add("render", "Render", &panel::hatched(&view.render, &view.counting), "")?;
    let map = Colormap::error();
    let painted = panel::paint(errors, size, 0.0, error_high, &map);
    add(
        "error",
        "Error",
        &panel::hatched(&painted, &view.counting),
        &scale(&map, "0", &format!("\u{2265} {error_high} / 255")),
    )?;
    if let Some(depth) = &view.depth {
        let (picture, (low, high)) = panel::depth(depth);
        let bar = scale(&Colormap::depth(), &significant(f64::from(low)), &significant(f64::from(high)));
        add("depth", "Depth", &picture, &bar)?;
    }
    for (kind, title, picture) in view.stages.iter().flat_map(StagePanel::pictures) {
        add(kind, title, picture, "")?;
    }
    let gap = "<span class=\"gap\"></span>";
    let lpips = view.lpips_squeeze.map_or_else(String::new, |v| format!(" {gap} LPIPS <b>{v:.3}</b>"));
    Ok(fill(
        include_str!("view.html"),
        &[
            ("number", &number.to_string()),
            ("name", &escape(&view.name)),
            ("psnr", &decibels(Some(view.psnr))),
            ("ssim", &fraction(view.ssim, 3)),
            ("lpips", &lpips),
            ("masked", &masked(&view.counting)),
            ("shape", if size.1 > size.0 { " portrait" } else { "" }),
            ("aspect", &format!("{} / {}", size.0.max(1), size.1.max(1))),
            ("panels", &panels),
        ],
    ))
}

/// Says what is hatched, where something is.
fn masked(counting: &[bool]) -> String {
    let out = counting.iter().filter(|counts| !**counts).count();
    match out {
        0 => String::new(),
        n => {
            let share = 100.0 * n as f64 / counting.len() as f64;
            let share = if share < 1.0 { "less than 1".to_owned() } else { format!("{share:.0}") };
            format!("<p class=\"masked\">Hatched: masked, {share} % of the pixels, without a part in the scores</p>")
        }
    }
}

fn scale(map: &Colormap, low: &str, high: &str) -> String {
    format!(
        "<span class=\"scale\"><span>{low}</span><span class=\"ramp\" style=\"background:{}\"></span>\
         <span>{high}</span></span>",
        panel::gradient(map)
    )
}
