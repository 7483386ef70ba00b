//! The comparison as a page that stands for itself: the table, and PSNR against splats and against seconds.

use std::fmt::Write;

use super::plan::Size;
use super::table::{Finished, markdown};
use crate::format::markup::escape;
use crate::numbers::fraction;

const COLOURS: [&str; 8] = ["#1b6ca8", "#d1495b", "#3a7d44", "#edae49", "#6a4c93", "#00798c", "#8d6a9f", "#555555"];
const WIDTH: f64 = 520.0;
const HEIGHT: f64 = 340.0;
const LEFT: f64 = 56.0;
const BOTTOM: f64 = 44.0;
const TOP: f64 = 28.0;
const RIGHT: f64 = 30.0;
/// Height of a line of the legend.
const LINE: f64 = 14.0;

/// HTML without outside requests.
pub fn page(title: &str, finished: &[Finished]) -> String {
    let mut out = format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>{0}</title><style>body{{font:15px/1.45 sans-serif;\
         margin:2rem auto;max-width:72rem;padding:0 1rem;color:#222}}table{{border-collapse:collapse;margin:1rem 0}}td,th{{border:1px \
         solid #ccc;padding:.25rem .5rem;text-align:left}}figure{{display:inline-block;margin:.5rem}}</style></head><body><h1>{0}</h1>\n",
        escape(title)
    );
    tables(&mut out, &markdown(finished));
    let mut scenes: Vec<&str> = Vec::new();
    for f in finished {
        if !scenes.contains(&f.run.scene.as_str()) {
            scenes.push(&f.run.scene);
        }
    }
    for scene in scenes {
        let of: Vec<&Finished> = finished.iter().filter(|f| f.run.scene == scene).collect();
        let _ = writeln!(out, "<h2>{}</h2>", escape(scene));
        for (name, number) in
            [("splats", (|f| f.metrics.splats as f64) as fn(&Finished) -> f64), ("seconds", |f| f.seconds)]
        {
            let _ = writeln!(out, "<figure>{}</figure>", plot(name, &of, number));
        }
    }
    out + "</body></html>\n"
}

/// Markdown tables as HTML; other lines as paragraphs.
fn tables(out: &mut String, text: &str) {
    let mut inside = false;
    for line in text.lines() {
        let cells = line.strip_prefix('|').and_then(|l| l.strip_suffix('|')).map(cells);
        match cells {
            Some(cells) if cells.iter().all(|c| !c.is_empty() && c.chars().all(|c| c == '-')) => {}
            Some(cells) => {
                let tag = if inside { "td" } else { "th" };
                if !inside {
                    out.push_str("<table>");
                }
                inside = true;
                out.push_str("<tr>");
                for cell in cells {
                    let _ = write!(out, "<{tag}>{}</{tag}>", escape(&cell));
                }
                out.push_str("</tr>\n");
            }
            None => {
                if inside {
                    out.push_str("</table>\n");
                }
                inside = false;
                if !line.is_empty() {
                    let _ = writeln!(out, "<p>{}</p>", escape(line));
                }
            }
        }
    }
    if inside {
        out.push_str("</table>\n");
    }
}

/// The cells of a row of a Markdown table, as text: what is escaped with `\` in it is not.
fn cells(row: &str) -> Vec<String> {
    let (mut out, mut cell, mut chars) = (Vec::new(), String::new(), row.chars());
    while let Some(c) = chars.next() {
        match c {
            '\\' => cell.extend(chars.next()),
            '|' => out.push(std::mem::take(&mut cell).trim().to_owned()),
            c => cell.push(c),
        }
    }
    out.push(cell.trim().to_owned());
    out
}

/// Digits after the point with which labels that are a step apart differ evenly.
fn digits(step: f64) -> usize {
    (1.0 - step.log10().floor()).clamp(0.0, 6.0) as usize
}

/// PSNR against a number, a point for each run, those of a method joined in the order of their splats where they were
/// limited.
fn plot(name: &str, finished: &[&Finished], number: fn(&Finished) -> f64) -> String {
    let points: Vec<(&Finished, f64, f64)> =
        finished.iter().filter_map(|f| Some((*f, number(f), f.metrics.psnr?))).collect();
    let range = |values: &mut dyn Iterator<Item = f64>| {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        values.for_each(|v| (low, high) = (low.min(v), high.max(v)));
        let room = (0.08 * (high - low)).max(1e-3 * high.abs()).max(1e-9);
        (low - room, high + room)
    };
    let mut labels: Vec<&str> = Vec::new();
    for (f, ..) in &points {
        if !labels.contains(&f.run.label.as_str()) {
            labels.push(&f.run.label);
        }
    }
    let height = HEIGHT + LINE * lines(&labels).last().map_or(0.0, |(_, line)| *line as f64);
    let mut out =
        format!("<svg viewBox=\"0 0 {WIDTH} {height}\" width=\"{WIDTH}\" font-family=\"sans-serif\" font-size=\"12\">");
    let _ = write!(out, "<text x=\"{LEFT}\" y=\"16\" font-weight=\"bold\">PSNR (dB) against {name}</text>");
    if points.is_empty() {
        return out + "</svg>";
    }
    let (x0, x1) = range(&mut points.iter().map(|p| p.1));
    let (y0, y1) = range(&mut points.iter().map(|p| p.2));
    let sx = |x: f64| LEFT + (x - x0) / (x1 - x0) * (WIDTH - LEFT - RIGHT);
    let sy = |y: f64| HEIGHT - BOTTOM - (y - y0) / (y1 - y0) * (HEIGHT - TOP - BOTTOM);
    let (x_digits, y_digits) = (digits((x1 - x0) / 4.0), digits((y1 - y0) / 4.0).max(2));
    for k in 0..=4 {
        let share = f64::from(k) / 4.0;
        let (x, y) = (x0 + share * (x1 - x0), y0 + share * (y1 - y0));
        let (px, py, bottom) = (sx(x), sy(y), HEIGHT - BOTTOM);
        let _ = write!(
            out,
            "<path d=\"M{px:.1} {TOP}V{bottom}M{LEFT} {py:.1}H{}\" stroke=\"#ddd\"/><text x=\"{px:.1}\" y=\"{}\" \
             text-anchor=\"middle\">{}</text><text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            WIDTH - RIGHT,
            bottom + 16.0,
            fraction(x, x_digits),
            LEFT - 4.0,
            py + 4.0,
            fraction(y, y_digits)
        );
    }
    for (i, label) in labels.iter().enumerate() {
        let (stroke, fill) = colours(i);
        let mut own: Vec<&(&Finished, f64, f64)> = points.iter().filter(|(f, ..)| f.run.label == *label).collect();
        own.sort_by(|a, b| a.1.total_cmp(&b.1));
        if own.iter().any(|(f, ..)| f.run.size != Size::Own) {
            let path: Vec<String> = own.iter().map(|p| format!("{:.1} {:.1}", sx(p.1), sy(p.2))).collect();
            let _ = write!(out, "<path d=\"M{}\" fill=\"none\" stroke=\"{stroke}\"/>", path.join("L"));
        }
        for (_, x, y) in own {
            let (x, y) = (sx(*x), sy(*y));
            let _ = write!(out, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" stroke=\"{stroke}\" fill=\"{fill}\"/>");
        }
    }
    out + &legend(&labels) + "</svg>"
}

/// The colours of a label's circles: line and inside. Beyond the number of colours circles are hollow.
fn colours(i: usize) -> (&'static str, &'static str) {
    let colour = COLOURS[i % COLOURS.len()];
    (colour, if (i / COLOURS.len()).is_multiple_of(2) { colour } else { "#fff" })
}

/// Lines of labels under a plot, each with as many as it has room for.
fn lines(labels: &[&str]) -> Vec<(f64, usize)> {
    let (mut x, mut line) = (LEFT, 0);
    let mut places = Vec::new();
    for label in labels {
        let width = (24.0 + 7.0 * label.chars().count() as f64).max(110.0);
        if x > LEFT && x + width > WIDTH {
            (x, line) = (LEFT, line + 1);
        }
        places.push((x, line));
        x += width;
    }
    places
}

fn legend(labels: &[&str]) -> String {
    let mut out = String::new();
    for (i, (label, (x, line))) in labels.iter().zip(lines(labels)).enumerate() {
        let ((stroke, fill), y) = (colours(i), HEIGHT - 8.0 + LINE * line as f64);
        let _ = write!(
            out,
            "<circle cx=\"{}\" cy=\"{}\" r=\"4\" stroke=\"{stroke}\" fill=\"{fill}\"/><text x=\"{}\" y=\"{y}\">{}</text>",
            x + 8.0,
            y - 4.0,
            x + 16.0,
            escape(label)
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_an_axis_differ_evenly() {
        for (low, high) in [(1.0, 3.0), (0.9, 3.2), (20.0, 20.3), (5.0, 900.0), (1e5, 1.00004e5)] {
            let (step, digits) = ((high - low) / 4.0, digits((high - low) / 4.0));
            let labels: Vec<f64> =
                (0..=4).map(|k| format!("{:.digits$}", low + f64::from(k) * step).parse().unwrap()).collect();
            assert!(labels.windows(2).all(|w| ((w[1] - w[0]) / step - 1.0).abs() < 0.11), "{labels:?}");
        }
    }

    #[test]
    fn labels_of_any_length_have_room_in_the_legend() {
        let numbers = |labels: &[&str]| lines(labels).into_iter().map(|(_, line)| line).collect::<Vec<_>>();
        let long = "3dgs:start=stereo:housekeeping=lean";
        assert_eq!(numbers(&["3dgs", "lean", "psrgs", "absgs", "gspro"]), [0, 0, 0, 0, 1]);
        assert_eq!(numbers(&[long, "psrgs", long]), [0, 0, 1]);
    }

    #[test]
    fn names_with_bars_stay_in_their_cells() {
        assert_eq!(cells(" a\\|b | \\`c\\\\ | 1 "), ["a|b", "`c\\", "1"]);
    }
}
