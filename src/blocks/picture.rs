//! The drawing of a plan.

use std::fmt::Write as _;

use super::plan::work;
use super::{Block, Planned};
use crate::byte_size::readable;
use crate::format::markup::escape;
use crate::numbers::{counted, fraction, grouped, percent};

/// Width of the drawing, and of the map in it.
const WIDTH: f64 = 860.0;
/// Largest height of the map.
const HEIGHT: f64 = 640.0;
/// Room around the map.
const EDGE: f64 = 20.0;
/// Height of the title, and of a line of the table.
const TITLE: f64 = 72.0;
const LINE: f64 = 20.0;
/// Most points, and most lines of the table.
const POINTS: usize = 4000;
const LINES: usize = 64;
/// Share of points and cameras at either end of an axis that may lie outside of the map.
const STRAYS: f64 = 0.005;
/// Smallest cell, in pixels, with figures inside.
const ROOM: [f64; 2] = [128.0, 78.0];

/// Colours of blocks, in light and in dark: neighbours of a row differ.
const COLOURS: [(&str, &str); 8] = [
    ("#1f6fb2", "#6bb3f0"),
    ("#b4540a", "#f0a05a"),
    ("#1d7f4e", "#62cf97"),
    ("#a3267f", "#ee86cf"),
    ("#6d4bb8", "#b39af2"),
    ("#8a6d00", "#dcc04e"),
    ("#0b7a86", "#5fd0dc"),
    ("#b3263a", "#f58a98"),
];

/// Where ground coordinates lie in the drawing.
struct Sheet {
    bounds: [f64; 4],
    scale: f64,
}

impl Sheet {
    fn of(planned: &Planned) -> Self {
        let cameras = || planned.cameras.iter().map(|(_, place)| place);
        let range = |k: usize| {
            let ends = |mut along: Vec<f64>| -> Option<[f64; 2]> {
                along.sort_unstable_by(f64::total_cmp);
                let strays = (STRAYS * along.len() as f64) as usize;
                Some([*along.get(strays)?, *along.get(along.len().checked_sub(1 + strays)?)?])
            };
            let of_points = ends(planned.points.iter().map(|place| place[k]).collect()).unwrap_or([0.0, 1.0]);
            // Cameras far outside of what they see are not waited for.
            let reach = of_points[1] - of_points[0];
            let of_cameras = ends(cameras().map(|place| place[k]).collect()).unwrap_or(of_points);
            let (low, high) = (of_points[0] - 0.5 * reach, of_points[1] + 0.5 * reach);
            [of_points[0].min(of_cameras[0].max(low)), of_points[1].max(of_cameras[1].min(high))]
        };
        let [x, y] = [range(0), range(1)];
        let longest = (x[1] - x[0]).max(y[1] - y[0]);
        let longest = if longest > 0.0 { longest } else { 1.0 };
        // A line of cameras gets a map of some height too.
        let wide = |[low, high]: [f64; 2]| {
            let more = 0.04 * longest + 0.5 * (0.15 * longest - (high - low)).max(0.0);
            [low - more, high + more]
        };
        let ([x0, x1], [y0, y1]) = (wide(x), wide(y));
        let scale = ((WIDTH - 2.0 * EDGE) / (x1 - x0)).min(HEIGHT / (y1 - y0));
        Self { bounds: [x0, x1, y0, y1], scale }
    }

    fn size(&self) -> [f64; 2] {
        let [x0, x1, y0, y1] = self.bounds;
        [self.scale * (x1 - x0), self.scale * (y1 - y0)]
    }

    /// Pixels of a place; `None` outside of the map. North is at the top.
    fn at(&self, [x, y]: [f64; 2]) -> Option<[f64; 2]> {
        let [x0, x1, y0, y1] = self.bounds;
        let inside = (x0..=x1).contains(&x) && (y0..=y1).contains(&y);
        inside.then_some([EDGE + self.scale * (x - x0), TITLE + self.scale * (y1 - y)])
    }

    /// Left, top, width and height in pixels of bounds `[x0, x1, y0, y1]`, cut to the map. `None` outside of the map.
    fn rectangle(&self, [u0, u1, v0, v1]: [f64; 4]) -> Option<[f64; 4]> {
        let [x0, x1, y0, y1] = self.bounds;
        let (u0, u1, v0, v1) = (u0.max(x0), u1.min(x1), v0.max(y0), v1.min(y1));
        let [left, top] = self.at([u0, v1])?;
        (u0 < u1 && v0 < v1).then_some([left, top, self.scale * (u1 - u0), self.scale * (v1 - v0)])
    }
}

/// The drawing of a plan as an SVG file that is legible in light and in dark: cells with their margins, cameras in the
/// colour of the block that sees most of their photograph, points of the surface, and a table.
pub fn picture(planned: &Planned) -> String {
    let sheet = Sheet::of(planned);
    let blocks = &planned.file.blocks;
    let [width, height] = sheet.size();
    let lines = blocks.len().min(LINES);
    let more = if blocks.len() > lines { 1 } else { 0 };
    let below = TITLE + height + 30.0;
    let whole = below + LINE * (lines + more + 1) as f64 + 12.0;
    let middle = 0.5 * (WIDTH - width) - EDGE;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {whole:.0}\" width=\"{WIDTH}\" \
         height=\"{whole:.0}\" role=\"img\" aria-label=\"Plan of blocks\">{}<rect class=\"sheet\" width=\"{WIDTH}\" \
         height=\"{whole:.0}\"/>{}<g transform=\"translate({middle:.1} 0)\">",
        style(),
        title(planned)
    );
    svg += &map(planned, &sheet);
    svg += "</g>";
    svg += &table(planned, below, lines);
    svg += "</svg>\n";
    svg
}

fn style() -> String {
    let mut style = String::from(
        "<style>.sheet{fill:#fff}text{font:13px system-ui,sans-serif;fill:#1b1f24}.title{font-weight:600;\
         font-size:17px}.soft{fill:#59636e}.head{fill:#59636e;font-size:12px}.number{text-anchor:end;\
         font-variant-numeric:tabular-nums}.inside{text-anchor:middle}.id{font-weight:700;font-size:15px}\
         .map{fill:#f4f6f8;stroke:#c3ccd5}.point{fill:#59636e;fill-opacity:.45}.halo{paint-order:stroke;stroke:#f4f6f8;\
         stroke-width:4px;stroke-linejoin:round}.scale{stroke:#1b1f24;stroke-width:2}",
    );
    for (k, (light, dark)) in COLOURS.iter().enumerate() {
        // Writing to a String cannot fail.
        let _ = write!(style, ".c{k}{{--c:{light};--d:{dark}}}");
    }
    style += ".cell{fill:var(--c);fill-opacity:.13;stroke:var(--c);stroke-width:2}.margin{fill:none;stroke:var(--c);\
              stroke-dasharray:5 4;stroke-opacity:.75}.camera{fill:var(--c);stroke:#fff;stroke-width:.7}\
              .key{fill:var(--c)}@media(prefers-color-scheme:dark){.sheet{fill:#15191e}text{fill:#e6eaee}\
              .soft,.head{fill:#9aa6b2}.map{fill:#1d232a;stroke:#3a444f}.point{fill:#9aa6b2}\
              .halo{stroke:#1d232a}.scale{stroke:#e6eaee}.cell{fill:var(--d);stroke:var(--d)}\
              .margin{stroke:var(--d)}.camera{fill:var(--d);stroke:#15191e}.key{fill:var(--d)}}</style>";
    style
}

fn title(planned: &Planned) -> String {
    let file = &planned.file;
    let photographs = file.global.photographs.len();
    format!(
        "<text class=\"title\" x=\"{EDGE}\" y=\"24\">{} of {}</text><text class=\"soft\" x=\"{EDGE}\" y=\"44\">{} to train \
         on, about {} splats</text><text class=\"soft\" x=\"{EDGE}\" y=\"61\">dashed: how far a block is trained beyond \
         its cell; dots: cameras, in the colour of the block that sees most of their photograph</text>",
        counted(file.blocks.len(), "block"),
        escape(&name(planned)),
        counted(photographs, "photograph"),
        grouped(planned.splats as u64),
    )
}

fn name(planned: &Planned) -> String {
    let path = &planned.file.dataset.path;
    path.file_name().map_or_else(|| path.display().to_string(), |name| name.to_string_lossy().into_owned())
}

fn map(planned: &Planned, sheet: &Sheet) -> String {
    let [width, height] = sheet.size();
    let mut svg =
        format!("<rect class=\"map\" x=\"{EDGE}\" y=\"{TITLE}\" width=\"{width:.1}\" height=\"{height:.1}\"/>");
    let every = planned.points.len().div_ceil(POINTS).max(1);
    for [x, y] in planned.points.iter().step_by(every).filter_map(|place| sheet.at(*place)) {
        let _ = write!(svg, "<circle class=\"point\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"1.1\"/>");
    }
    for (k, block) in planned.file.blocks.iter().enumerate() {
        let inside = block.cell.inside(sheet.bounds);
        let Some([x, y, w, h]) = sheet.rectangle(inside) else { continue };
        let colour = k % COLOURS.len();
        let _ = write!(
            svg,
            "<g class=\"c{colour}\"><rect id=\"{}\" class=\"cell\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" \
             height=\"{h:.1}\"/>",
            escape(&block.id)
        );
        let m = block.margin;
        let [u0, u1, v0, v1] = inside;
        if let Some([x, y, w, h]) = sheet.rectangle([u0 - m, u1 + m, v0 - m, v1 + m]) {
            let _ =
                write!(svg, "<rect class=\"margin\" x=\"{x:.1}\" y=\"{y:.1}\" width=\"{w:.1}\" height=\"{h:.1}\"/>");
        }
        svg += "</g>";
    }
    let homes = homes(&planned.file.blocks);
    for (name, place) in &planned.cameras {
        let (Some([x, y]), Some(block)) = (sheet.at(*place), homes.get(name.as_str())) else { continue };
        let colour = block % COLOURS.len();
        let _ = write!(
            svg,
            "<g class=\"c{colour}\"><circle class=\"camera\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3.4\"><title>{}</title>\
             </circle></g>",
            escape(name)
        );
    }
    for block in &planned.file.blocks {
        if let Some(rectangle) = sheet.rectangle(block.cell.inside(sheet.bounds)) {
            svg += &label(block, rectangle);
        }
    }
    svg + &scale_bar(sheet)
}

/// For each photograph the block that sees most of it.
fn homes(blocks: &[Block]) -> std::collections::HashMap<&str, usize> {
    let mut best: std::collections::HashMap<&str, (usize, f64)> = std::collections::HashMap::new();
    for (k, block) in blocks.iter().enumerate() {
        for photograph in &block.photographs {
            let home = best.entry(photograph.name.as_str()).or_insert((k, photograph.share));
            if photograph.share > home.1 {
                *home = (k, photograph.share);
            }
        }
    }
    best.into_iter().map(|(name, (k, _))| (name, k)).collect()
}

fn label(block: &Block, [x, y, w, h]: [f64; 4]) -> String {
    let (x, y) = (x + 0.5 * w, y + 0.5 * h);
    if w < ROOM[0] || h < ROOM[1] {
        return format!("<text class=\"inside id halo\" x=\"{x:.1}\" y=\"{:.1}\">{}</text>", y + 5.0, block.id);
    }
    let figures = [
        counted(block.predicted_splats, "splat"),
        readable(block.predicted_memory),
        counted(block.photographs.len(), "photograph"),
    ];
    let mut svg = format!("<text class=\"inside id halo\" x=\"{x:.1}\" y=\"{:.1}\">{}</text>", y - 18.0, block.id);
    for (line, text) in (0..).zip(figures) {
        let down = y + f64::from(line) * 16.0;
        let _ = write!(svg, "<text class=\"inside halo\" x=\"{x:.1}\" y=\"{down:.1}\">{text}</text>");
    }
    svg
}

/// A bar of a round length in dataset units.
fn scale_bar(sheet: &Sheet) -> String {
    let [width, height] = sheet.size();
    let wanted = 0.2 * width / sheet.scale;
    let power = 10.0_f64.powf(wanted.log10().floor());
    let length = [5.0, 2.0, 1.0].into_iter().map(|times| times * power).find(|l| *l <= wanted).unwrap_or(power);
    let (x, y) = (EDGE, TITLE + height + 10.0);
    let digits = usize::try_from((-power.log10().floor()) as i64).unwrap_or(0);
    format!(
        "<path class=\"scale\" d=\"M{x} {y:.1}h{:.1}\"/><text class=\"soft\" x=\"{:.1}\" y=\"{:.1}\">{} units of the \
         dataset</text>",
        length * sheet.scale,
        x + length * sheet.scale + 8.0,
        y + 4.5,
        fraction(length, digits)
    )
}

fn table(planned: &Planned, top: f64, lines: usize) -> String {
    let ends = [190.0, 300.0, 430.0, 560.0, 680.0, WIDTH - EDGE];
    let heads = ["photographs", "steps", "splats", "memory", "time", "share of work"];
    let mut svg = format!("<text class=\"head\" x=\"{:.1}\" y=\"{:.1}\">block</text>", EDGE + 18.0, top + 14.0);
    for (x, head) in ends.iter().zip(heads) {
        let _ = write!(svg, "<text class=\"head number\" x=\"{x}\" y=\"{:.1}\">{head}</text>", top + 14.0);
    }
    let blocks = &planned.file.blocks;
    let work = shares(blocks);
    for (k, (block, work)) in blocks.iter().zip(work).enumerate().take(lines) {
        let y = top + LINE * (k + 1) as f64;
        let _ = write!(
            svg,
            "<g class=\"c{}\"><rect class=\"key\" x=\"{EDGE}\" y=\"{:.1}\" width=\"11\" height=\"11\" rx=\"2\"/></g>\
             <text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            k % COLOURS.len(),
            y + 4.0,
            EDGE + 18.0,
            y + 14.0,
            block.id
        );
        let time = block.predicted_seconds.map_or_else(|| "unknown".to_owned(), minutes);
        let figures = [
            grouped(block.photographs.len() as u64),
            grouped(block.steps),
            grouped(block.predicted_splats),
            readable(block.predicted_memory),
            time,
            percent(work, 1),
        ];
        for (x, figure) in ends.iter().zip(figures) {
            let _ = write!(svg, "<text class=\"number\" x=\"{x}\" y=\"{:.1}\">{figure}</text>", y + 14.0);
        }
    }
    if blocks.len() > lines {
        let y = top + LINE * (lines + 1) as f64 + 14.0;
        let _ = write!(svg, "<text class=\"soft\" x=\"{EDGE}\" y=\"{y:.1}\">and {} more</text>", blocks.len() - lines);
    }
    svg
}

/// The share that each block has of the work.
pub(super) fn shares(blocks: &[Block]) -> Vec<f64> {
    let of = |block: &Block| (block.steps as usize, block.predicted_splats as f64);
    work(&blocks.iter().map(of).collect::<Vec<_>>())
}

/// A time in words.
pub(super) fn minutes(seconds: f64) -> String {
    match seconds {
        s if s < 90.0 => format!("{} s", fraction(s, 0)),
        s if s < 5400.0 => format!("{} min", fraction(s / 60.0, 0)),
        s => format!("{} h", fraction(s / 3600.0, 1)),
    }
}
