//! Growth of time and memory: log-log plots of several benchmarks as one SVG, and their slopes.

use std::fmt::Write;

use crate::format::markup::escape;

/// A quantity measured at several sizes.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name of the quantity, with its unit.
    pub name: String,
    /// Size and value, both positive.
    pub points: Vec<(f64, f64)>,
}

const WIDTH: f64 = 460.0;
const HEIGHT: f64 = 320.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 18.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 46.0;

/// Least-squares slope of the logarithms over the sizes of at least a tenth of the largest: 1 where values grow in
/// proportion to size. At smaller sizes fixed costs hide the growth.
pub fn slope(points: &[(f64, f64)]) -> Option<f64> {
    let largest = points.iter().map(|p| p.0).fold(0.0, f64::max);
    let logs: Vec<(f64, f64)> =
        points.iter().filter(|p| p.0 >= 0.099 * largest && p.1 > 0.0).map(|p| (p.0.ln(), p.1.ln())).collect();
    let n = logs.len() as f64;
    let mean = |f: fn(&(f64, f64)) -> f64| logs.iter().map(f).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let across = logs.iter().map(|p| (p.0 - x) * (p.0 - x)).sum::<f64>();
    let along = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>();
    (logs.len() >= 2 && across > 0.0).then(|| along / across)
}

/// A panel per series, side by side, both axes logarithmic, with a thin line of slope 1 through the largest size.
pub fn svg(sizes: &str, series: &[Series]) -> String {
    let width = WIDTH * series.len().max(1) as f64;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {HEIGHT}\" font-family=\"sans-serif\" \
         font-size=\"12\">\
         \n<rect width=\"{width}\" height=\"{HEIGHT}\" fill=\"#fff\"/>\n"
    );
    for (i, one) in series.iter().enumerate() {
        let _ = write!(out, "<g transform=\"translate({} 0)\">", WIDTH * i as f64);
        panel(&mut out, sizes, one);
        out += "</g>\n";
    }
    out + "</svg>\n"
}

fn panel(out: &mut String, sizes: &str, series: &Series) {
    let mut points: Vec<(f64, f64)> = series.points.iter().copied().filter(|p| p.0 > 0.0 && p.1 > 0.0).collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let slope = slope(&points).map_or(String::new(), |s| format!(" (slope {s:.2} over the last tenfold)"));
    let _ = write!(out, "<text x=\"{LEFT}\" y=\"20\" font-weight=\"bold\">{}{slope}</text>", escape(&series.name));
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return };
    let (x0, x1) = decades(points.iter().map(|p| p.0));
    let (y0, y1) = decades(points.iter().map(|p| p.1));
    let at = |low: f64, high: f64, value: f64| (value.log10() - low) / (high - low);
    let sx = |x: f64| LEFT + at(x0, x1, x) * (WIDTH - LEFT - RIGHT);
    let sy = |y: f64| HEIGHT - BOTTOM - at(y0, y1, y) * (HEIGHT - TOP - BOTTOM);
    let (bottom, right) = (HEIGHT - BOTTOM, WIDTH - RIGHT);
    for power in x0 as i32..=x1 as i32 {
        let (x, label) = (sx(10f64.powi(power)), label(power));
        let _ = write!(
            out,
            "<path d=\"M{x:.1} {TOP}V{bottom}\" stroke=\"#ddd\"/><text x=\"{x:.1}\" y=\"{}\" \
             text-anchor=\"middle\">{label}</text>",
            bottom + 16.0
        );
    }
    for power in y0 as i32..=y1 as i32 {
        let (y, label) = (sy(10f64.powi(power)), label(power));
        let _ = write!(
            out,
            "<path d=\"M{LEFT} {y:.1}H{right}\" stroke=\"#ddd\"/><text x=\"{}\" y=\"{:.1}\" \
             text-anchor=\"end\">{label}</text>",
            LEFT - 6.0,
            y + 4.0
        );
    }
    let _ = write!(
        out,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
        (LEFT + right) / 2.0,
        HEIGHT - 8.0,
        escape(sizes)
    );
    // The line of slope 1, from the largest size back to the edge of the panel.
    let from = first.0.max(last.0 * 10f64.powf(y0) / last.1);
    let _ = write!(
        out,
        "<path d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"#999\" stroke-dasharray=\"4 4\"/>",
        sx(from),
        sy(last.1 * from / last.0),
        sx(last.0),
        sy(last.1)
    );
    let line: Vec<String> = points.iter().map(|p| format!("{:.1},{:.1}", sx(p.0), sy(p.1))).collect();
    let _ =
        write!(out, "<polyline points=\"{}\" fill=\"none\" stroke=\"#1f6fb4\" stroke-width=\"2\"/>", line.join(" "));
    for (x, y) in points {
        let _ = write!(
            out,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"3.5\" fill=\"#1f6fb4\"><title>{x}: {y}</title></circle>",
            sx(x),
            sy(y)
        );
    }
}

/// Whole powers of ten that enclose the values, at least one apart.
fn decades(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let low = values.clone().fold(f64::INFINITY, f64::min).log10().floor();
    let high = values.fold(0.0, f64::max).log10().ceil();
    (low, high.max(low + 1.0))
}

fn label(power: i32) -> String {
    match power {
        0..=2 => format!("{}", 10i32.pow(power as u32)),
        3..=5 => format!("{}k", 10i32.pow(power as u32 - 3)),
        6..=8 => format!("{}M", 10i32.pow(power as u32 - 6)),
        _ => format!("1e{power}"),
    }
}

#[cfg(test)]
mod tests {
    use super::{Series, slope, svg};

    #[test]
    fn slopes_are_those_of_powers() {
        let points = |power: f64| -> Vec<(f64, f64)> {
            [1e4, 1e5, 3e5, 1e6].into_iter().map(|x: f64| (x, 7.0 * x.powf(power))).collect()
        };
        for power in [0.0, 0.5, 1.0, 2.0] {
            let found = slope(&points(power)).expect("a slope");
            assert!((found - power).abs() < 1e-9, "{found} for {power}");
        }
        // A fixed cost at small sizes does not count.
        let mut flat = points(1.0);
        flat[0].1 = 1e9;
        assert!((slope(&flat).expect("a slope") - 1.0).abs() < 1e-9);
        assert_eq!(slope(&[(5.0, 5.0)]), None);
        assert_eq!(slope(&[]), None);
    }

    #[test]
    fn odd_series_are_drawn() {
        let series = |points: &[(f64, f64)]| Series { name: "a < b".into(), points: points.to_vec() };
        let all = [series(&[]), series(&[(10.0, 10.0)]), series(&[(1e6, 0.5), (1e4, 2000.0)]), series(&[(0.0, 1.0)])];
        let drawn = svg("splats", &all);
        assert!(!drawn.contains("NaN") && !drawn.contains("inf") && drawn.contains("a &lt; b"), "{drawn}");
        assert_eq!((drawn.matches("<circle").count(), drawn.matches("<g ").count()), (3, 4));
    }
}
