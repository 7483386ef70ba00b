//! A plan as a table in text.

use super::picture::{minutes, shares};
use super::{Cell, PlanFile};
use crate::byte_size::readable;
use crate::numbers::{fraction, grouped, percent};

/// The blocks of a plan, a line each, under a line of headings.
pub fn table(plan: &PlanFile) -> String {
    let heads = ["block", "cell", "photographs", "steps", "splats", "memory", "time", "share of work"];
    let mut rows = vec![heads.map(str::to_owned)];
    for (block, work) in plan.blocks.iter().zip(shares(&plan.blocks)) {
        rows.push([
            block.id.clone(),
            edges(&block.cell),
            grouped(block.photographs.len() as u64),
            grouped(block.steps),
            grouped(block.predicted_splats),
            readable(block.predicted_memory),
            block.predicted_seconds.map_or_else(|| "-".to_owned(), minutes),
            percent(work, 1),
        ]);
    }
    let widths: [usize; 8] = std::array::from_fn(|k| rows.iter().map(|row| row[k].chars().count()).max().unwrap_or(0));
    let line = |row: [String; 8]| {
        let cell = |(k, text): (usize, &String)| {
            let width = widths[k];
            // Words to the left, numbers to the right.
            if k < 2 { format!("{text:<width$}") } else { format!("{text:>width$}") }
        };
        format!("{}\n", row.iter().enumerate().map(cell).collect::<Vec<_>>().join("  ").trim_end())
    };
    rows.into_iter().map(line).collect()
}

/// Edges of a cell, with as many digits as tell them apart.
fn edges(cell: &Cell) -> String {
    let of = |[from, to]: [Option<f64>; 2]| {
        let edge = |edge: Option<f64>| edge.map_or_else(|| "..".to_owned(), |at| fraction(at, digits(at)));
        format!("{} to {}", edge(from), edge(to))
    };
    format!("{}, {}", of(cell.x), of(cell.y))
}

fn digits(at: f64) -> usize {
    if at.abs() >= 100.0 { 1 } else { 3 }
}
