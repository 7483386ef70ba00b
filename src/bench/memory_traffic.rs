//! Bytes that each pass moves by design.

use crate::raster::sort::{Digits, SortShape};
use crate::raster::tiles::{DEPTH_BITS, tile_bits};
use crate::raster::{GradientSum, ListSort, PLANES, Variants};

/// Mean amounts of work per timed step.
#[derive(Clone, Copy, Debug)]
pub struct Work {
    /// Splats of the model.
    pub splats: f64,
    /// Splats on screen.
    pub visible: f64,
    /// (splat, tile) pairs.
    pub pairs: f64,
    /// Pixels of a view.
    pub pixels: f64,
    /// Tiles of a view.
    pub tiles: f64,
    /// Splats that fit into the buffers.
    pub splat_capacity: f64,
    /// (splat, tile) pairs that fit into the buffers.
    pub pair_capacity: f64,
    /// Most words that one pass sums.
    pub most_at_once: u64,
    /// Tiles that fit into the buffers.
    pub tile_capacity: f64,
    /// Degree of the spherical harmonics in use.
    pub sh_degree: u32,
    /// Whether only the visible splats take an optimiser step.
    pub listed: bool,
    /// Words in which the optimiser keeps both moments of a parameter: 2, or 1 where they are packed.
    pub moment_words: u32,
    /// Variants of the passes.
    pub variants: Variants,
    /// Variant of the sorts.
    pub shape: SortShape,
    /// Digits of the sort by depth.
    pub depth: Digits,
    /// Digits of the sort by tile.
    pub tile: Digits,
}

/// Bytes of the columns of `splat2d`, `grad2d` and `slot_grads`.
const ROW_2D: f64 = 48.0;
/// Bytes of one group of spherical harmonics.
const SH: f64 = 48.0;
/// Bytes of mean, quaternion, scales and opacity.
const GEOMETRY: f64 = 44.0;

/// Parameters of a splat.
pub(super) fn parameters() -> f64 {
    f64::from(PLANES.iter().map(|(_, row)| row).sum::<u32>())
}

impl Work {
    /// Groups of spherical harmonics in use.
    fn sh_groups(&self) -> f64 {
        match self.sh_degree {
            0 | 1 => 1.0,
            2 => 3.0,
            _ => 4.0,
        }
    }

    /// Floats of a splat that the fused optimiser step touches, as a mean over steps. Harmonics above the degree in use
    /// are left out by rows of four.
    pub(super) fn stepped(&self) -> f64 {
        let harmonics = match self.sh_degree {
            0 => 4.0,
            1 => 12.0,
            2 => 28.0,
            _ => 48.0,
        };
        GEOMETRY / 4.0 + harmonics
    }

    /// Whether the splats on the image are listed where lists do not need them listed.
    fn lists_visible(&self) -> bool {
        self.listed || self.variants.gradients == GradientSum::Slots
    }

    /// Splats that take an optimiser step.
    pub(super) fn splats_stepped(&self) -> f64 {
        if self.listed { self.visible } else { self.splats }
    }

    /// Words of keys and words of digit count tables, summed over all digits of both sorts.
    fn sorted(&self) -> (f64, f64) {
        let one = |keys: f64, digits: Digits| {
            let passes = f64::from(digits.passes);
            let blocks = (keys / f64::from(self.shape.block())).ceil();
            (passes * keys, passes * blocks * f64::from(digits.rows()))
        };
        let (a, b) = (one(self.visible, self.depth), one(self.pairs, self.tile));
        (a.0 + b.0, a.1 + b.1)
    }

    /// Words in prefix sums of one pass and of three: splats, visible splats, tables.
    fn summed(&self) -> [f64; 2] {
        let table = |keys: f64, digits: Digits| {
            f64::from(digits.passes) * (keys / f64::from(self.shape.block())).ceil() * f64::from(digits.rows())
        };
        let most = |capacity: f64, bits: u32| self.shape.table_words(capacity as u64, bits);
        let sums = [
            (self.splats + self.visible, self.splat_capacity as u64),
            (table(self.visible, self.depth), most(self.splat_capacity, DEPTH_BITS)),
            (table(self.pairs, self.tile), most(self.pair_capacity, tile_bits(self.tile_capacity as u64))),
        ];
        let in_tiles = [(if self.lists_visible() { self.splats } else { 0.0 }, self.splat_capacity as u64)];
        let sums = match (self.variants.lists, self.shape) {
            (ListSort::Global, SortShape::Runs) => &sums[..],
            (ListSort::Global, SortShape::Groups) => &sums[..1],
            (ListSort::Tiles, _) => &in_tiles,
        };
        let mut words = [0.0; 2];
        sums.iter().for_each(|&(n, most)| words[usize::from(most > self.most_at_once)] += n);
        words
    }
}

/// Bytes that all dispatches of a pass read and write in one step. Each element counts once per thread or workgroup
/// that needs it; caches are ignored. `None` for passes that move a fixed few bytes. N splats, V visible, P pairs, g
/// groups of spherical harmonics in use:
///
/// | pass | bytes |
/// |---|---|
/// | `project` | N (44 parameters + 4 count) + V (48 g + 48 projected) |
/// | `compact` | N (4 count + 4 place) + V (4 depth + 8 key and value) |
/// | `radix_count` | per digit: 4 per key, 4 per table word |
/// | `radix_scatter` | per digit: 16 per key, 4 per table word |
/// | `radix_rows` | 8 per table word |
/// | `scan_reduce`, `scan_add`, `scan_spine`, `scan_once` | 4, 8, 8 / 1024, 8 per word of the sums (over N, V, tables of the runs shape) that take it |
/// | `gather_counts` | 12 V |
/// | `emit` | V (12 + 24 of the projected splat) + 12 P |
/// | `tile_edges` | 4 N + 24 V: additions to edges stay in caches |
/// | `tile_offsets` | 16 + 8 per tile |
/// | `emit_tiles` | 4 N + 32 V + 8 P, with slots 4 P more |
/// | `tile_sort` | P (8 + 4) + 16 per tile, with slots 8 P more |
/// | `tile_ranges` | 16 P + 8 per tile |
/// | `blend_forward` | P (4 + 48 projected) + 8 per tile + 20 per pixel: a list is read to its end |
/// | `loss_strips`, `loss_grad` | 20 + 3 x 12, 20 + 3 x 12 + 16 per pixel: the overlap of strips and windows is left aside |
/// | `blend_backward` | as forward, 36 per pixel, and P (4 + 48) to slots, or 96 P of read and written sums |
/// | `slot_sum` | V (12 + 48) + 48 P |
/// | `project_backward_adam` | N (4 count + 24, or 16 with packed moments, per parameter that the step has: it and its moments read and written) + V (16 colour + 48 gradient); with `--visible-adam` V for N, and 8 V of the last step |
/// | `project_backward` | N (4 + 236 gradients) + V (44 + 48 g + 16 colour + 48 gradient) |
/// | `densify_stats` | 4 N + V (16 + 32) |
/// | `densify_views` | 4 N + (N - V) (40 + 16) |
/// | `adam` | 28 per parameter: gradient, parameter and moments read, the last three written |
/// | `clear` | the tile ranges, and `grad2d` where there are no slots |
pub fn bytes(pass: &str, work: &Work) -> Option<f64> {
    let Work { splats: n, visible: v, pairs: p, pixels, tiles, .. } = *work;
    let slots = work.variants.gradients == GradientSum::Slots;
    let sh = SH * work.sh_groups();
    let lists = (4.0 + ROW_2D) * p + 8.0 * tiles;
    let (keys, tables) = work.sorted();
    let parameters = parameters();
    let is = |family: &str| pass.strip_prefix(family).is_some_and(|rest| rest.is_empty() || rest.starts_with('_'));
    let [at_once, in_blocks] = work.summed();
    // A longer name stands before a name that it begins with.
    let families: [(&str, f64); 27] = [
        (
            "project_backward_adam",
            work.splats_stepped() * (4.0 + 8.0 * f64::from(1 + work.moment_words) * work.stepped())
                + v * (16.0 + ROW_2D + if work.listed { 8.0 } else { 0.0 }),
        ),
        ("project_backward", n * (4.0 + 4.0 * parameters) + v * (GEOMETRY + sh + 16.0 + ROW_2D)),
        ("project", n * (GEOMETRY + 4.0) + v * (sh + ROW_2D)),
        ("compact", 8.0 * n + 12.0 * v),
        ("radix_count", 4.0 * keys + 4.0 * tables),
        ("radix_scatter", 16.0 * keys + 4.0 * tables),
        ("radix_rows", 8.0 * tables),
        ("scan_once", 8.0 * at_once),
        ("scan_reduce", 4.0 * in_blocks),
        ("scan_add", 8.0 * in_blocks),
        ("scan_spine", 8.0 * in_blocks / f64::from(crate::raster::scan::BLOCK)),
        ("gather_counts", 12.0 * v),
        ("emit_tiles", 4.0 * n + 32.0 * v + p * if slots { 12.0 } else { 8.0 }),
        ("emit", 36.0 * v + 12.0 * p),
        ("tile_edges", 4.0 * n + 24.0 * v),
        ("tile_offsets", 24.0 * tiles),
        ("tile_sort", p * if slots { 20.0 } else { 12.0 } + 16.0 * tiles),
        ("tile_ranges", 16.0 * p + 8.0 * tiles),
        ("blend_forward", lists + 20.0 * pixels),
        ("loss_strips", 56.0 * pixels),
        ("loss_grad", 72.0 * pixels),
        ("blend_backward", lists + 36.0 * pixels + p * if slots { 4.0 + ROW_2D } else { 2.0 * ROW_2D }),
        ("slot_sum", v * (12.0 + ROW_2D) + ROW_2D * p),
        ("densify_stats", 4.0 * n + v * (16.0 + 32.0)),
        ("densify_views", 4.0 * n + (n - v) * (40.0 + 16.0)),
        ("adam", 28.0 * parameters * n),
        ("clear", 8.0 * work.tile_capacity + if slots { 0.0 } else { ROW_2D * work.splat_capacity }),
    ];
    families.iter().find(|(name, _)| is(name)).map(|(_, bytes)| *bytes)
}
