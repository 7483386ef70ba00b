//! Time against error as an SVG, one panel per table.

use std::fmt::Write;

use super::Table;
use crate::format::markup::escape;

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 380.0;
const LEFT: f64 = 84.0;
const RIGHT: f64 = 24.0;
const TOP: f64 = 40.0;
const BOTTOM: f64 = 52.0;

/// An axis. Logarithmic where all values are positive and differ by more than a factor of 8.
struct Axis {
    low: f64,
    high: f64,
    logarithmic: bool,
}

impl Axis {
    fn of(values: &[f64]) -> Self {
        let (least, most) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(*v), b.max(*v)));
        let logarithmic = least > 0.0 && most > 8.0 * least;
        let (low, high) = if logarithmic { (least.log10(), most.log10()) } else { (least, most) };
        // The margin keeps small differences from filling the panel.
        let margin = ((high - low) * 0.08).max(if logarithmic { 0.1 } else { 0.05 * high.abs().max(1e-30) });
        let floor = if logarithmic || least < 0.0 { f64::NEG_INFINITY } else { 0.0 };
        Self { low: (low - margin).max(floor), high: high + margin, logarithmic }
    }

    fn share(&self, v: f64) -> f64 {
        let v = if self.logarithmic { v.log10() } else { v };
        (v - self.low) / (self.high - self.low)
    }

    /// Five positions with their labels.
    fn ticks(&self) -> Vec<(f64, String)> {
        let at = |k: u32| self.low + (self.high - self.low) * f64::from(k) / 4.0;
        let text = |v: f64| match self.logarithmic {
            true => format!("{:.1e}", 10f64.powf(v)),
            false if v.abs() >= 0.01 && v.abs() < 1e5 => format!("{v:.2}"),
            false => format!("{v:.1e}"),
        };
        (0..5).map(|k| (f64::from(k) / 4.0, text(at(k)))).collect()
    }
}

/// Panels side by side: time to the right, error upwards, settings by their number in the table. Dominated settings are
/// hollow, the default is a square, and a line joins the front.
pub fn svg(tables: &[Table]) -> String {
    let width = WIDTH * tables.len().max(1) as f64;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {HEIGHT}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n\
         <rect width=\"{width}\" height=\"{HEIGHT}\" fill=\"#fff\"/>\n"
    );
    for (k, table) in tables.iter().enumerate() {
        let _ = write!(out, "<g transform=\"translate({} 0)\">", WIDTH * k as f64);
        panel(&mut out, table);
        out += "</g>\n";
    }
    out + "</svg>\n"
}

fn panel(out: &mut String, table: &Table) {
    let title = table.title.split(':').next().unwrap_or_default();
    let _ = write!(out, "<text x=\"{LEFT}\" y=\"20\" font-weight=\"bold\">{}</text>", escape(title));
    let numbered = table.settings.iter().zip(1..);
    let mut points: Vec<_> = numbered.filter_map(|(s, k)| Some((s, s.time, s.error?, k))).collect();
    points.retain(|(_, time, error, _)| time.is_finite() && error.is_finite());
    if points.is_empty() {
        return;
    }
    points.sort_by(|a, b| a.1.total_cmp(&b.1));
    let x = Axis::of(&points.iter().map(|p| p.1).collect::<Vec<_>>());
    let y = Axis::of(&points.iter().map(|p| p.2).collect::<Vec<_>>());
    let sx = |v: f64| LEFT + x.share(v) * (WIDTH - LEFT - RIGHT);
    let sy = |v: f64| HEIGHT - BOTTOM - y.share(v) * (HEIGHT - TOP - BOTTOM);
    for (share, text) in x.ticks() {
        let at = LEFT + share * (WIDTH - LEFT - RIGHT);
        let (bottom, base) = (HEIGHT - BOTTOM, HEIGHT - BOTTOM + 16.0);
        let _ = write!(
            out,
            "<line x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{TOP}\" y2=\"{bottom}\" stroke=\"#eee\"/>\
             <text x=\"{at:.1}\" y=\"{base}\" text-anchor=\"middle\" fill=\"#555\">{text}</text>"
        );
    }
    for (share, text) in y.ticks() {
        let at = HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM);
        let (right, left, base) = (WIDTH - RIGHT, LEFT - 6.0, at + 4.0);
        let _ = write!(
            out,
            "<line x1=\"{LEFT}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\" stroke=\"#eee\"/>\
             <text x=\"{left}\" y=\"{base:.1}\" text-anchor=\"end\" fill=\"#555\">{text}</text>"
        );
    }
    let _ = write!(
        out,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>\
         <text transform=\"translate(14 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
        (LEFT + WIDTH - RIGHT) / 2.0,
        HEIGHT - 10.0,
        escape(&table.time),
        (TOP + HEIGHT - BOTTOM) / 2.0,
        escape(&table.error)
    );
    let front: Vec<String> =
        points.iter().filter(|p| !p.0.dominated).map(|p| format!("{:.1},{:.1}", sx(p.1), sy(p.2))).collect();
    let _ =
        write!(out, "<polyline points=\"{}\" fill=\"none\" stroke=\"#1b6ca8\" stroke-width=\"1\"/>", front.join(" "));
    for (setting, time, error, number) in points {
        let (cx, cy) = (sx(time), sy(error));
        let fill = if setting.dominated { "#fff" } else { "#1b6ca8" };
        let style = format!("fill=\"{fill}\" stroke=\"#1b6ca8\" stroke-width=\"1.5\"");
        let said = format!("<title>{}: {time:.4} and {error:.3e}</title>", escape(&setting.name));
        let _ = match setting.default {
            true => write!(
                out,
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"10\" height=\"10\" {style}>{said}</rect>",
                cx - 5.0,
                cy - 5.0
            ),
            false => write!(out, "<circle cx=\"{cx:.1}\" cy=\"{cy:.1}\" r=\"4.5\" {style}>{said}</circle>"),
        };
        let _ = write!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" font-size=\"10\" fill=\"#333\">{number}</text>",
            cx + 6.0,
            cy - 5.0
        );
    }
}
