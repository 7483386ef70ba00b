//! What is known better than a map, on the map's cells.

use super::{Cells, Ground, Kind, Reference};
use crate::format::georaster::GeoRaster;
use crate::geodesy::{Error, Georeference, ReferenceSystem};
use crate::world::{Class, World};

/// Weights of red, green and blue in brightness.
const BRIGHTNESS: [f32; 3] = [0.299, 0.587, 0.114];

/// Heights, kinds and brightness on the cells of a map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Known {
    heights: Vec<f32>,
    /// Heights of the ground, where they are known apart from those of what stands on the ground.
    ground: Option<Vec<f32>>,
    kinds: Option<Vec<Kind>>,
    picture: Option<Vec<f32>>,
}

impl Known {
    /// Heights alone; all count as ground.
    pub fn of_heights(heights: Vec<f32>) -> Self {
        Self { heights, ..Self::default() }
    }

    /// The truth of a made-up world. `corner` is the north-western corner of the first cell on a map in `system`, or in
    /// the world's own coordinates.
    pub fn of_world(
        world: &World,
        cells: Cells,
        corner: [f64; 2],
        system: Option<&ReferenceSystem>,
    ) -> Result<Self, Error> {
        let way = match system {
            Some(system) => Georeference::of_coordinates(&world.coordinates(), Some(system.clone()))?,
            None => Georeference::local(),
        };
        let on_map = |column: f64, row: f64| [corner[0] + cells.gsd * column, corner[1] - cells.gsd * row];
        // A world is so small that lines of the map are straight lines in the world, to less than a millimetre. All
        // places are at the height of the world's origin.
        let level = way.to_map([0.0; 3])[2];
        let in_world = |column: f64, row: f64| {
            let [east, north] = on_map(column, row);
            way.to_dataset([east, north, level])
        };
        let (width, height) = (cells.width as f64, cells.height as f64);
        let (first, right, down) = (in_world(0.0, 0.0), in_world(width, 0.0), in_world(0.0, height));
        let place = |column: f64, row: f64| {
            let (u, v) = (column / width, row / height);
            [0, 1].map(|k| first[k] + u * (right[k] - first[k]) + v * (down[k] - first[k]))
        };
        let seen = world.from_above((cells.width as u32, cells.height as u32), place);
        let middle = |k: usize| place((k % cells.width) as f64 + 0.5, (k / cells.width) as f64 + 0.5);
        let up = |(k, z): (usize, &f32)| {
            let [x, y] = middle(k);
            way.to_map([x, y, f64::from(*z)])[2] as f32
        };
        let ground: Vec<f32> = (0..seen.heights.len()).map(|k| seen.ground(world, k, middle(k))).collect();
        let kind = |class: &Option<Class>| match class {
            Some(Class::Ground) => Kind::Ground,
            Some(Class::Building) => Kind::Roof,
            _ => Kind::Other,
        };
        let pixels = seen.picture.as_raw().chunks_exact(3).zip(&seen.classes);
        let picture = pixels.map(|(rgb, class)| match class {
            Some(_) => (0..3).map(|k| BRIGHTNESS[k] * f32::from(rgb[k])).sum(),
            None => f32::NAN,
        });
        Ok(Self {
            heights: seen.heights.iter().enumerate().map(up).collect(),
            ground: Some(ground.iter().enumerate().map(up).collect()),
            kinds: Some(seen.classes.iter().map(kind).collect()),
            picture: Some(picture.collect()),
        })
    }

    /// Heights of another surface model in the same system, interpolated at the middles of the cells.
    pub fn of_raster(raster: &GeoRaster, cells: Cells, corner: [f64; 2]) -> Self {
        let at = |k: usize| {
            let (column, row) = ((k % cells.width) as f64 + 0.5, (k / cells.width) as f64 + 0.5);
            raster.at(0, [corner[0] + cells.gsd * column, corner[1] - cells.gsd * row])
        };
        Self::of_heights((0..cells.width * cells.height).map(at).collect())
    }

    /// The ground, for the comparison of a terrain model. What is not known apart counts as ground.
    pub fn ground(&self) -> Ground<'_> {
        Ground { heights: self.ground.as_ref().unwrap_or(&self.heights), kinds: self.kinds.as_deref() }
    }

    /// As the comparison takes it.
    pub fn reference(&self) -> Reference<'_> {
        Reference { heights: &self.heights, kinds: self.kinds.as_deref(), picture: self.picture.as_deref() }
    }
}

/// Brightness of an orthophoto of red, green, blue and perhaps alpha; NaN where there is no data.
pub fn brightness(orthophoto: &GeoRaster) -> Vec<f32> {
    let bands = orthophoto.bands;
    let of = |pixel: &[f32]| match bands {
        4.. if pixel[3] == 0.0 => f32::NAN,
        3.. => (0..3).map(|k| BRIGHTNESS[k] * pixel[k]).sum(),
        _ => pixel[0],
    };
    orthophoto.values.chunks_exact(bands.max(1)).map(of).collect()
}
