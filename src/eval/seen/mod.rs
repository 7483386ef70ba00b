//! Which pixels of held-out photographs at least one photograph to train on sees: made from the data alone, so that
//! the region is the same for whatever is compared in it.

mod depths;

use std::collections::HashMap;

use rayon::prelude::*;

use super::geometry::{GeometryError, depth_maps};
use super::{ImageScore, psnr_where};
use crate::dataset::{self, Dataset, HostShare, Pixels, Role, View};
use crate::scene::Camera;
use depths::Depths;

/// The longer side of the grid on which it is decided what is seen; pixels have what the cell around them has.
const SIDE: u32 = 200;

/// The pixels of held-out photographs that at least one photograph to train on sees.
///
/// A pixel is lifted to its depth: the true one where the dataset has `depth/NAME.exr`, else one interpolated from the
/// reconstructed points. It is seen where it comes to lie before a camera that is trained on, inside of its picture,
/// and is not masked there. What hides it is not looked for. Where nothing is known of a depth, a pixel counts as seen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeenPixels {
    grids: HashMap<String, Grid>,
}

/// Yes or no for the cells of a picture.
#[derive(Clone, Debug, PartialEq)]
struct Grid {
    width: u32,
    height: u32,
    cells: Vec<bool>,
}

/// Where the picture of a photograph counts: neither masked nor transparent, nor beyond what the lens has shown.
#[derive(Clone, Debug)]
pub struct Counting {
    size: [f64; 2],
    /// Everywhere without.
    grid: Option<Grid>,
}

impl Counting {
    /// Of a photograph, which is decoded if it may have masked pixels.
    pub fn of(view: &View) -> Result<Self, dataset::Error> {
        Ok(Self::with(&view.camera, Grid::counting(view)?))
    }

    /// Everywhere in the picture.
    pub fn everywhere(camera: &Camera) -> Self {
        Self::with(camera, None)
    }

    fn with(camera: &Camera, grid: Option<Grid>) -> Self {
        Self { size: [f64::from(camera.width), f64::from(camera.height)], grid }
    }

    /// Whether a place, in pixels, is inside of the picture and counts.
    pub fn at(&self, [x, y]: [f64; 2]) -> bool {
        let [width, height] = self.size;
        let inside = x >= 0.0 && y >= 0.0 && x < width && y < height;
        let counts = |grid: &Grid| {
            let cell = |at: f64, size: u32, of: f64| (at * f64::from(size) / of) as usize;
            let (column, row) = (cell(x, grid.width, width), cell(y, grid.height, height));
            grid.cells.get(row * grid.width as usize + column).copied().unwrap_or(false)
        };
        inside && self.grid.as_ref().is_none_or(counts)
    }
}

/// A camera that is trained on.
struct Eye {
    camera: Camera,
    center: [f64; 3],
    counting: Counting,
}

impl SeenPixels {
    /// Of the held-out photographs of a dataset. `trained_on` says of a photograph to train on whether it really is.
    /// Those that may have masked pixels are decoded, as `share` has room for them.
    pub fn of(dataset: &Dataset, share: &HostShare, trained_on: impl Fn(&str) -> bool) -> Result<Self, GeometryError> {
        let train: Vec<&View> =
            dataset.views_of(Role::Train).map(|(_, view)| view).filter(|view| trained_on(&view.name)).collect();
        let costs: Vec<u64> = train.iter().map(|view| view.decoding_bytes()).collect();
        let eye = |at: usize| {
            let view = train.get(at)?;
            // One that cannot be decoded is not trained on.
            let counting = Counting::of(view).ok()?;
            Some(Eye { camera: view.camera, center: view.camera.center(), counting })
        };
        let eyes: Vec<Eye> = share.in_turns(&costs, eye).into_iter().flatten().collect();
        let held_out: Vec<usize> = dataset.views_of(Role::HeldOut).map(|(at, _)| at).collect();
        let maps = depth_maps(dataset, &held_out);
        let grid = |(at, map): (&usize, _)| {
            let depths = Depths::of(dataset, *at, map)?;
            Ok(dataset.views.get(*at).map(|view| (view.name.clone(), Grid::seen(&view.camera, &depths, &eyes))))
        };
        let grids: Vec<_> = held_out.par_iter().zip(maps).map(grid).collect::<Result<_, GeometryError>>()?;
        Ok(Self { grids: grids.into_iter().flatten().collect() })
    }

    /// Which pixels of a held-out photograph are seen, row-major; all of one that is not known.
    pub fn of_photograph(&self, name: &str, (width, height): (u32, u32)) -> Vec<bool> {
        match self.grids.get(name) {
            Some(grid) => grid.enlarged(width, height),
            None => vec![true; width as usize * height as usize],
        }
    }

    /// A score with the share of the pixels that are seen, and PSNR of the 8-bit render in these. Pixels that are
    /// masked in the photograph have no part in either.
    pub fn with_score(&self, score: ImageScore, size: (u32, u32), photograph: &Pixels, rgb: &[u8]) -> ImageScore {
        let counting = photograph.counting();
        let seen = self.of_photograph(&score.name, size);
        let both: Vec<bool> = counting.iter().zip(seen).map(|(counts, seen)| *counts && seen).collect();
        let of = |cells: &[bool]| cells.iter().filter(|cell| **cell).count() as f64;
        let share = of(&both) / of(&counting);
        ImageScore { psnr_seen: psnr_where(rgb, &photograph.rgb8(), &both), seen: Some(share), ..score }
    }
}

/// The size of the grid for a picture.
fn grid_size(camera: &Camera) -> (u32, u32) {
    let longer = camera.width.max(camera.height).max(1);
    let side = |side: u32| (u64::from(side) * u64::from(SIDE.min(longer))).div_ceil(u64::from(longer)) as u32;
    (side(camera.width).max(1), side(camera.height).max(1))
}

impl Grid {
    /// Which cells of a held-out photograph at least one of `eyes` sees.
    fn seen(camera: &Camera, depths: &Depths, eyes: &[Eye]) -> Self {
        let (width, height) = grid_size(camera);
        // The nearest first: most cells are seen by one of those.
        let center = camera.center();
        let mut order: Vec<(f64, &Eye)> = eyes.iter().map(|eye| (squared_distance(eye.center, center), eye)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        let seen = |k: u32| {
            let middle = |at: u32, of: u32, size: u32| (f64::from(at) + 0.5) * f64::from(size) / f64::from(of);
            let at = [middle(k % width, width, camera.width), middle(k / width, height, camera.height)];
            let Some(depth) = depths.at(at) else { return true };
            let point = lifted(camera, at, depth);
            order.iter().any(|(_, eye)| eye.sees(point))
        };
        Self { width, height, cells: (0..width * height).into_par_iter().map(seen).collect() }
    }

    /// Where the picture of a photograph counts: neither masked nor transparent, nor beyond what the lens has shown.
    /// `None` where all of it does.
    fn counting(view: &View) -> Result<Option<Self>, dataset::Error> {
        let (width, height) = grid_size(&view.camera);
        let camera = view.camera.resized(width, height);
        let cells = match &view.lens {
            _ if view.path.as_os_str().is_empty() => return Ok(None),
            // Such a file has no transparency.
            Some(lens) if view.jpeg && view.mask.is_none() => {
                let inside = |k: u32| {
                    let at = [f64::from(k % width) + 0.5, f64::from(k / width) + 0.5];
                    let ray = [(at[0] - camera.cx) / camera.fx, (at[1] - camera.cy) / camera.fy];
                    let within = |at: [f64; 2]| (0..2).all(|k| at[k] >= 0.0 && at[k] <= f64::from(lens.size[k]));
                    lens.project(ray).is_some_and(|(at, _)| within(at))
                };
                (0..width * height).map(inside).collect()
            }
            None if view.jpeg && view.mask.is_none() => return Ok(None),
            _ => {
                let mut pixels = View { camera, ..view.clone() }.photograph()?.pixels;
                pixels.harden_alpha();
                pixels.counting()
            }
        };
        let grid = Self { width, height, cells };
        Ok(if grid.cells.iter().all(|counts| *counts) { None } else { Some(grid) })
    }

    fn enlarged(&self, width: u32, height: u32) -> Vec<bool> {
        let nearest = |at: u32, of: u32, size: u32| u64::from(at) * u64::from(size) / u64::from(of);
        let columns: Vec<u64> = (0..width).map(|x| nearest(x, width, self.width)).collect();
        let row = |y: u32| nearest(y, height, self.height) * u64::from(self.width);
        (0..height).flat_map(|y| columns.iter().map(move |x| self.cells[(row(y) + x) as usize])).collect()
    }
}

impl Eye {
    fn sees(&self, point: [f64; 3]) -> bool {
        projected(&self.camera, point).is_some_and(|(at, _)| self.counting.at(at))
    }
}

/// The place in the picture of a point before the camera, and its depth.
fn projected(camera: &Camera, point: [f64; 3]) -> Option<([f64; 2], f64)> {
    let [x, y, z]: [f64; 3] = std::array::from_fn(|i| {
        let row = camera.rotation[i];
        camera.translation[i] + (0..3).map(|k| row[k] * point[k]).sum::<f64>()
    });
    (z > 0.0).then(|| ([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], z))
}

/// The point that a camera shows at a place of its picture, at this depth.
fn lifted(camera: &Camera, at: [f64; 2], depth: f64) -> [f64; 3] {
    let (r, t) = (&camera.rotation, &camera.translation);
    let in_camera = [(at[0] - camera.cx) / camera.fx * depth, (at[1] - camera.cy) / camera.fy * depth, depth];
    std::array::from_fn(|i| (0..3).map(|k| r[k][i] * (in_camera[k] - t[k])).sum())
}

fn squared_distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum()
}

#[cfg(test)]
mod tests {
    use super::depths::tests::{SIZE, of_ground, tilted};
    use super::*;
    use crate::dataset::LoadOptions;
    use crate::dataset::lens::Lens;
    use crate::world::{CameraKind, LidarParams, WorldParams, generate};

    fn eye(camera: Camera, counting: Option<Grid>) -> Eye {
        Eye { center: camera.center(), camera, counting: Counting::with(&camera, counting) }
    }

    /// The columns of the picture that are seen, all of a column alike.
    fn columns(eyes: &[Eye]) -> Vec<bool> {
        let camera = tilted(0.0, [0.0, 0.0, 10.0]);
        let grid = Grid::seen(&camera, &of_ground(&camera), eyes);
        assert_eq!((grid.width, grid.height), (100, 80));
        let row = |y: usize| grid.cells[100 * y..100 * (y + 1)].to_vec();
        assert!((1..80).all(|y| row(y) == row(0)));
        row(0)
    }

    /// A pixel is 0.1 m of ground. A camera 3 m to the right sees what begins 30 pixels from the left, and where the
    /// left half of its picture is masked, what begins 80 pixels from there.
    #[test]
    fn what_a_shifted_camera_sees_begins_where_it_does() {
        let from = |first: usize| (0..100).map(|x| x >= first).collect::<Vec<bool>>();
        let right = tilted(0.0, [3.0, 0.0, 10.0]);
        assert_eq!(columns(&[]), [false; 100]);
        assert_eq!(columns(&[eye(right, None)]), from(30));
        let half = || Grid { width: 2, height: 1, cells: vec![false, true] };
        assert_eq!(columns(&[eye(right, Some(half()))]), from(80));
        assert_eq!(columns(&[eye(right, Some(half())), eye(tilted(0.0, [6.0, 0.0, 10.0]), None)]), from(60));
        // Below the ground it is behind a camera that looks down.
        assert_eq!(columns(&[eye(tilted(0.0, [0.0, 0.0, -10.0]), None)]), [false; 100]);
        // One above and one beside it: all.
        assert_eq!(columns(&[eye(right, None), eye(tilted(0.0, [-6.0, 0.0, 10.0]), None)]), {
            let mut both = from(30);
            both[..40].fill(true);
            both
        });
    }

    /// What a lens shows is known without the pixels, as the pixels say it; a mask takes its part away.
    #[test]
    fn masks_and_lenses_say_where_a_picture_counts() {
        let dir = tempfile::tempdir().unwrap();
        let params = WorldParams {
            images: 2,
            max_side: 96,
            offpath: 0,
            supersample: 1,
            camera: CameraKind::Opencv,
            lidar: LidarParams { density: 0.1, ..LidarParams::default() },
            ..WorldParams::default()
        };
        generate(&params, dir.path(), &mut |_| ()).unwrap();
        let load = || Dataset::load(dir.path(), &LoadOptions::default()).unwrap().views;
        let mut view = load().remove(0);
        let lens = view.lens.expect("a lens");
        // Moved, so that it shows nothing at the right of the picture.
        let center = [lens.center[0] + 0.2 * f64::from(lens.size[0]), lens.center[1]];
        view.lens = Some(Lens::new(lens.focal, center, lens.size, lens.distortion));
        let by_lens = Grid::counting(&view).unwrap().expect("a rim without a picture");
        let by_pixels = Grid::counting(&View { jpeg: false, ..view.clone() }).unwrap().expect("the same");
        let share = |grid: &Grid| grid.cells.iter().filter(|counts| **counts).count() as f64 / grid.cells.len() as f64;
        println!("{} by the lens, {} by pixels", share(&by_lens), share(&by_pixels));
        assert!(view.jpeg && (0.6..0.9).contains(&share(&by_lens)) && by_lens == by_pixels);
        // The left half of the file is masked.
        let (width, height) = view.size_on_disk;
        let mask = image::GrayImage::from_fn(width, height, |x, _| image::Luma([if 2 * x < width { 0 } else { 255 }]));
        std::fs::create_dir(dir.path().join("masks")).unwrap();
        mask.save(dir.path().join("masks").join(format!("{}.png", view.name))).unwrap();
        let masked = Grid::counting(&load()[0]).unwrap().expect("a mask");
        let side = |right: bool| {
            let of_side = masked
                .cells
                .iter()
                .enumerate()
                .filter(|(k, _)| (2 * (*k as u32 % masked.width) >= masked.width) == right);
            of_side.filter(|(_, counts)| **counts).count() as f64
        };
        assert!(side(false) < 0.1 * side(true) && share(&masked) > 0.4, "{} and {}", side(false), side(true));
    }

    #[test]
    fn cells_are_enlarged_to_their_nearest_pixels() {
        let grid = Grid { width: 2, height: 2, cells: vec![true, false, false, true] };
        let row = |a: bool, b: bool| [a, a, b, b];
        assert_eq!(grid.enlarged(4, 3), [row(true, false), row(true, false), row(false, true)].concat());
        let camera = Camera { width: 4000, height: 3000, ..tilted(0.0, [0.0; 3]) };
        assert_eq!(grid_size(&camera), (200, 150));
        assert_eq!(grid_size(&Camera { width: 1, height: 4000, ..camera }), (1, 200));
    }

    /// Half of the pixels are seen, of which half are masked; the others do not count, however wrong they are.
    #[test]
    fn psnr_of_what_is_seen_leaves_out_the_rest() {
        let (width, height) = (SIZE[0] as u32, 2);
        let grid = Grid { width: 2, height: 1, cells: vec![true, false] };
        let seen = SeenPixels { grids: HashMap::from([("a".to_owned(), grid)]) };
        let pixel = |k: u32| [100, 100, 100, if k % width < 25 { 0 } else { 255 }];
        let photograph = Pixels::Rgba8((0..width * height).flat_map(pixel).collect());
        let render: Vec<u8> =
            (0..width * height).flat_map(|k| [if (25..50).contains(&(k % width)) { 110 } else { 255 }; 3]).collect();
        let score = |name: &str| ImageScore {
            name: name.into(),
            psnr: 1.0,
            psnr_seen: None,
            seen: None,
            psnr_cc: 2.0,
            ssim: 0.5,
            lpips_squeeze: None,
            gmsd: None,
            psnr_high_frequency: None,
        };
        let found = seen.with_score(score("a"), (width, height), &photograph, &render);
        let expected = 20.0 * (255.0_f64 / 10.0).log10();
        assert!(found.psnr_seen.is_some_and(|psnr| (psnr - expected).abs() < 1e-9), "{found:?}");
        assert!(found.seen.is_some_and(|share| (share - 1.0 / 3.0).abs() < 1e-12), "of the pixels that count");
        let all = seen.with_score(score("b"), (width, height), &photograph, &render);
        assert_eq!(all.seen, Some(1.0), "of a photograph that is not known all is seen");
        let none =
            SeenPixels { grids: HashMap::from([("a".into(), Grid { width: 1, height: 1, cells: vec![false] })]) };
        let nothing = none.with_score(score("a"), (width, height), &photograph, &render);
        assert_eq!((nothing.psnr_seen, nothing.seen), (None, Some(0.0)));
        assert_eq!(super::super::mean_seen(&[nothing, found.clone()]), found.psnr_seen, "of those that have some");
    }
}
