//! Line charts as inline SVG.

use std::fmt::Write;

use super::text::{rounded, tick};
use super::{Curve, CurveForm};
use crate::format::markup::escape;
use crate::numbers::grouped;

const WIDTH: f64 = 420.0;
const HEIGHT: f64 = 230.0;
const LEFT: f64 = 50.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 34.0;
/// Points drawn at most; longer curves are drawn by the mean of their parts, with the range as a band.
const PARTS: usize = 240;

/// The largest number of dots and steps that are drawn. Longer curves are thinned out evenly.
const DOTS: usize = 1000;

/// Values over a stretch of steps.
struct Part {
    step: f64,
    mean: f64,
    low: f64,
    high: f64,
}

/// The range of both axes with their ticks, and where values lie between them.
struct Axes {
    x: Axis,
    y: Axis,
}

/// From one value to another, with round values in between and how far apart these are.
struct Axis {
    from: f64,
    to: f64,
    ticks: Vec<f64>,
    spacing: f64,
}

impl Axes {
    /// `steps` go along x, values between `low` and `high` along y; a range that starts near zero is drawn from zero.
    fn new(steps: [f64; 2], low: f64, high: f64) -> Self {
        let low = if low > 0.0 && low < 0.35 * high { 0.0 } else { low };
        let (y_ticks, y_spacing) = ticks(low, high, 5);
        let (from, to) = (y_ticks[0].min(low), y_ticks[y_ticks.len() - 1].max(high));
        let [first, last] = steps;
        let (x_ticks, x_spacing) = ticks(first, last, 5);
        Self {
            x: Axis { from: first, to: last, ticks: x_ticks, spacing: x_spacing },
            y: Axis { from, to, ticks: y_ticks, spacing: y_spacing },
        }
    }

    /// Where a step lies in the drawing.
    fn across(&self, step: f64) -> f64 {
        let Axis { from, to, .. } = self.x;
        LEFT + (step - from) / (to - from) * (WIDTH - LEFT - RIGHT)
    }

    /// Where a value lies in the drawing.
    fn down(&self, value: f64) -> f64 {
        let Axis { from, to, .. } = self.y;
        HEIGHT - BOTTOM - (value - from) / (to - from).max(1e-300) * (HEIGHT - TOP - BOTTOM)
    }

    /// The lines of the grid with their numbers, and the axis of steps with its own.
    fn drawn(&self) -> String {
        let mut svg = String::new();
        for &t in &self.y.ticks {
            let y = self.down(t);
            let _ = write!(
                svg,
                "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>\
                 <text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                WIDTH - RIGHT,
                LEFT - 7.0,
                y + 3.8,
                tick(t, self.y.spacing)
            );
        }
        for &t in self.x.ticks.iter().filter(|t| (self.x.from..=self.x.to).contains(*t)) {
            let (x, y) = (self.across(t), HEIGHT - BOTTOM);
            let _ = write!(
                svg,
                "<line class=\"axis\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{y:.1}\" y2=\"{:.1}\"/>\
                 <text class=\"tick\" x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                y + 4.0,
                y + 16.0,
                tick(t, self.x.spacing)
            );
        }
        let floor = HEIGHT - BOTTOM;
        let _ = write!(
            svg,
            "<line class=\"axis\" x1=\"{LEFT}\" x2=\"{:.1}\" y1=\"{floor}\" y2=\"{floor}\"/>\
             <text class=\"tick\" x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">step</text>",
            WIDTH - RIGHT,
            WIDTH - RIGHT,
            HEIGHT - 3.0
        );
        svg
    }
}

/// One figure: title, unit, axes from step 0 to `steps`, line. The drawn points go along as data for the reading under
/// the cursor.
pub(super) fn figure(curve: &Curve, number: usize, steps: f64) -> String {
    let points: Vec<(f64, f64)> =
        curve.points.iter().copied().filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
    let heading = format!(
        "<figcaption><span class=\"name\">{}</span> <span class=\"unit\">{}</span></figcaption>",
        escape(&curve.name),
        escape(&curve.unit)
    );
    let (Some(&first), Some(&last)) = (points.first(), points.last()) else {
        return format!("<figure class=\"chart\">{heading}<p class=\"empty\">no values</p></figure>");
    };
    let parts = if curve.form == CurveForm::Line { parts(&points) } else { some(&points) };
    let low = parts.iter().map(|p| p.low).fold(f64::INFINITY, f64::min);
    let high = parts.iter().map(|p| p.high).fold(f64::NEG_INFINITY, f64::max);
    let axes = Axes::new([first.0.min(0.0), steps.max(last.0).max(1.0)], low, high);
    let svg = axes.drawn() + &marks(&parts, curve.form, &axes);
    let data: Vec<String> = parts
        .iter()
        .map(|p| {
            let (step, mean) = (short(p.step.round()), short(p.mean));
            format!("{:.1}|{:.1}|{step}|{mean}", axes.across(p.step), axes.down(p.mean))
        })
        .collect();
    let summary = format!(
        "{} against training step: from {} at step {} to {} at step {}, lowest {}, highest {}",
        curve.name,
        short(first.1),
        short(first.0),
        short(last.1),
        short(last.0),
        short(low),
        short(high)
    );
    let floor = HEIGHT - BOTTOM;
    format!(
        "<figure class=\"chart chart{}\">{heading}<output class=\"reading\" aria-hidden=\"true\">{}</output>\
         <svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\" data-points=\"{}\">{svg}\
         <g class=\"cursor\" visibility=\"hidden\"><line class=\"rule\" y1=\"{TOP}\" y2=\"{floor}\"/>\
         <circle class=\"mark\" r=\"4\"/></g></svg></figure>",
        number % 3,
        escape(&format!("{} at step {}", short(last.1), short(last.0))),
        escape(&summary),
        data.join(";")
    )
}

/// The band of the range, the line and the dots of a curve, where its form has them.
fn marks(parts: &[Part], form: CurveForm, axes: &Axes) -> String {
    let mut svg = String::new();
    let at = |step: f64, value: f64| format!("{:.1},{:.1}", axes.across(step), axes.down(value));
    if parts.iter().any(|p| p.high > p.low) {
        let upper = parts.iter().map(|p| at(p.step, p.high));
        let lower = parts.iter().rev().map(|p| at(p.step, p.low));
        let outline: Vec<String> = upper.chain(lower).collect();
        let _ = write!(svg, "<polygon class=\"band\" points=\"{}\"/>", outline.join(" "));
    }
    let corners = corners(parts, form);
    if !corners.is_empty() {
        let line: Vec<String> = corners.iter().map(|(x, y)| at(*x, *y)).collect();
        let _ = write!(svg, "<polyline class=\"line\" points=\"{}\"/>", line.join(" "));
    }
    if form == CurveForm::Dots || form == CurveForm::Line && parts.len() <= 24 {
        for p in parts {
            let (x, y) = (axes.across(p.step), axes.down(p.mean));
            let _ = write!(svg, "<circle class=\"dot\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\"/>");
        }
    }
    svg
}

/// The points that a line joins.
fn corners(parts: &[Part], form: CurveForm) -> Vec<(f64, f64)> {
    let mut corners: Vec<(f64, f64)> = Vec::new();
    for part in parts.iter().filter(|_| form != CurveForm::Dots) {
        if let (CurveForm::Steps, Some(&(_, before))) = (form, corners.last()) {
            corners.push((part.step, before));
        }
        corners.push((part.step, part.mean));
    }
    corners
}

fn parts(points: &[(f64, f64)]) -> Vec<Part> {
    let size = points.len().div_ceil(PARTS).max(1);
    points
        .chunks(size)
        .map(|c| {
            let n = c.len() as f64;
            Part {
                step: c.iter().map(|p| p.0).sum::<f64>() / n,
                mean: c.iter().map(|p| p.1).sum::<f64>() / n,
                low: c.iter().map(|p| p.1).fold(f64::INFINITY, f64::min),
                high: c.iter().map(|p| p.1).fold(f64::NEG_INFINITY, f64::max),
            }
        })
        .collect()
}

fn some(points: &[(f64, f64)]) -> Vec<Part> {
    let every = points.len().div_ceil(DOTS).max(1);
    points.iter().step_by(every).map(|&(step, mean)| Part { step, mean, low: mean, high: mean }).collect()
}

/// Round values that enclose [low, high] in about `count` steps of 1, 2 or 5 times a power of ten; at least two values.
fn ticks(low: f64, high: f64, count: usize) -> (Vec<f64>, f64) {
    let span = if high > low { high - low } else { low.abs().max(1.0) * 0.1 };
    let raw = span / count as f64;
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= raw * 0.999).unwrap_or(10.0 * power);
    let (from, to) = ((low / step + 1e-9).floor() as i64, (high / step - 1e-9).ceil() as i64);
    let to = to.max(from + 1);
    ((from..=to).map(|k| k as f64 * step).collect(), step)
}

/// A value to read: whole numbers as they are, else four significant digits.
fn short(value: f64) -> String {
    if value.fract() == 0.0 {
        return if value >= 10_000.0 { grouped(value as u64) } else { format!("{value}") };
    }
    rounded(value, 4)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_enclose() {
        assert_eq!(ticks(0.0, 1500.0, 5).0, [0.0, 500.0, 1000.0, 1500.0]);
        assert_eq!(ticks(17.3, 26.1, 5).0, [16.0, 18.0, 20.0, 22.0, 24.0, 26.0, 28.0]);
        for (low, high) in [(5.0, 5.0), (0.0, 0.0), (-3.0, 1e-7), (1e6, 1.7e6)] {
            let (t, _) = ticks(low, high, 5);
            assert!(t.len() >= 2 && t.len() <= 9, "{t:?}");
            assert!(t[0] <= low + 1e-9 && t[t.len() - 1] >= high - 1e-9, "{low} {high} {t:?}");
        }
    }

    #[test]
    fn odd_curves_are_drawn() {
        let curve = |points: Vec<(f64, f64)>| Curve { name: "x<y".into(), points, ..Curve::default() };
        assert!(figure(&curve(vec![]), 0, 9.0).contains("no values"));
        assert!(figure(&curve(vec![(1.0, f64::NAN)]), 0, 9.0).contains("no values"));
        let one = figure(&curve(vec![(10.0, 0.5)]), 1, 0.0);
        assert!(one.contains("x&lt;y") && !one.contains("NaN") && !one.contains("inf"), "{one}");
        let long = figure(&curve((0..5000).map(|k| (f64::from(k), f64::from(k % 7))).collect()), 2, 5000.0);
        assert!(long.contains("class=\"band\"") && long.len() < 40_000);
        let of_photographs = (0..60).map(|k| (f64::from(k), f64::from(k % 7))).collect();
        let dots = figure(&Curve { form: CurveForm::Dots, ..curve(of_photographs) }, 0, 60.0);
        assert_eq!(dots.matches("class=\"dot\"").count(), 60);
        assert!(!dots.contains("polyline"), "a line would tell of a change from one photograph to the next");
    }

    #[test]
    fn a_number_that_holds_goes_in_steps() {
        let part = |step: f64, mean: f64| Part { step, mean, low: mean, high: mean };
        let parts = [part(0.0, 5.0), part(10.0, 7.0), part(20.0, 2.0)];
        let steps = [(0.0, 5.0), (10.0, 5.0), (10.0, 7.0), (20.0, 7.0), (20.0, 2.0)];
        assert_eq!(corners(&parts, CurveForm::Steps), steps);
        assert_eq!(corners(&parts, CurveForm::Line), [(0.0, 5.0), (10.0, 7.0), (20.0, 2.0)]);
        assert_eq!(corners(&parts, CurveForm::Dots), []);
    }
}
