//! The world from straight above: true heights, true classes and a true orthophoto.

use glam::{DVec3, Vec3};
use image::RgbImage;
use rayon::prelude::*;

use super::light::develop;
use super::{Class, Ray, World};

/// Where rays begin, metres above everything.
const ABOVE: f64 = 1e4;

/// A world on a grid of cells, row-major.
#[derive(Clone, Debug)]
pub struct FromAbove {
    /// Cells in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Heights at the middles of cells; NaN beyond the ground.
    pub heights: Vec<f32>,
    /// What is at the middles of cells; nothing beyond the ground.
    pub classes: Vec<Option<Class>>,
    /// The cells' mean colours, with the nominal exposure and without noise; black beyond the ground.
    pub picture: RgbImage,
}

impl FromAbove {
    /// Height of the ground at the middle of a cell, which lies at x and y of the world, without what stands on the
    /// ground; NaN beyond the ground. Water is part of the ground.
    pub fn ground(&self, world: &World, cell: usize, [x, y]: [f64; 2]) -> f32 {
        self.classes[cell].map_or(f32::NAN, |_| world.terrain().height(x, y) as f32)
    }
}

impl World {
    /// Looks straight down at each cell of a grid. `place` leads from a column and a row, 0.5 in the middle of the first
    /// cell, to x and y of the world.
    pub fn from_above(&self, (width, height): (u32, u32), place: impl Fn(f64, f64) -> [f64; 2] + Sync) -> FromAbove {
        let samples = self.params().supersample.max(1);
        let down = |column: f64, row: f64| {
            let [x, y] = place(column, row);
            let ray = Ray { origin: DVec3::new(x, y, ABOVE), direction: DVec3::NEG_Z };
            self.trace(&ray).map(|hit| (ray, hit))
        };
        let cell = |k: u32| {
            let (column, row) = (f64::from(k % width), f64::from(k / width));
            let (mut sum, mut count) = (Vec3::ZERO, 0.0);
            for s in 0..samples * samples {
                let at = |k: u32| (f64::from(k) + 0.5) / f64::from(samples);
                if let Some((ray, hit)) = down(column + at(s % samples), row + at(s / samples)) {
                    sum += self.shade(&ray, &hit);
                    count += 1.0;
                }
            }
            let colour = if count > 0.0 { develop(sum / count) } else { Vec3::ZERO };
            let middle = down(column + 0.5, row + 0.5).map(|(ray, hit)| {
                let point = ray.at(hit.t);
                (point.z as f32, self.class(hit.surface, point))
            });
            (colour.to_array().map(|c| c.round().clamp(0.0, 255.0) as u8), middle)
        };
        let cells: Vec<_> = (0..width * height).into_par_iter().map(cell).collect();
        FromAbove {
            width,
            height,
            heights: cells.iter().map(|(_, middle)| middle.map_or(f32::NAN, |(z, _)| z)).collect(),
            classes: cells.iter().map(|(_, middle)| middle.map(|(_, class)| class)).collect(),
            picture: RgbImage::from_raw(width, height, cells.iter().flat_map(|(colour, _)| *colour).collect())
                .unwrap_or_default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{World, WorldParams};
    use super::*;

    #[test]
    fn heights_from_above_are_those_of_ground_and_roofs() {
        let params = WorldParams { extent: 40.0, images: 4, max_side: 32, supersample: 1, ..WorldParams::default() };
        let world = World::new(&params).expect("a world");
        let step = 0.5;
        let place = |column: f64, row: f64| [step * (column - 40.0), step * (40.0 - row)];
        let seen = world.from_above((80, 80), place);
        let mut found = [0; 2];
        for (k, (z, class)) in seen.heights.iter().zip(&seen.classes).enumerate() {
            let [x, y] = place((k % 80) as f64 + 0.5, (k / 80) as f64 + 0.5);
            let ground = world.terrain().height(x, y);
            match class {
                Some(Class::Ground) => assert!((f64::from(*z) - ground).abs() < 1e-4, "{z} at {x} {y}"),
                Some(Class::Building) => assert!(f64::from(*z) > ground, "{z} at {x} {y}"),
                _ => continue,
            }
            found[usize::from(*class == Some(Class::Building))] += 1;
        }
        assert!(found[0] > 1000 && found[1] > 100, "{found:?} cells of ground and of buildings");
        assert!(seen.picture.as_raw().iter().any(|v| *v > 100));
        // Nothing is below a cell that is not on the ground.
        let beyond = world.from_above((1, 1), |_, _| [1e6, 0.0]);
        assert!(beyond.heights[0].is_nan() && beyond.classes[0].is_none());
    }
}
