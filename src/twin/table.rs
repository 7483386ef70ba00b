//! The table of passes and their twins.

use super::{
    TwinCall, adam, blend_backward, blend_forward, compact, constrain, convolution, crop, densify_axes,
    densify_classify, densify_finish, densify_gather, densify_limit, densify_map, densify_means, densify_order,
    densify_sample, densify_scores, densify_stats, densify_views, depth_probe, emit, emit_tiles, exposure,
    feature_distance, fill, geometry, gradient_map, loss, noise, opacity_reset, photograph_reduce, plan, pool, probe,
    project, project_backward, project_backward_adam, project_backward_adam_packed, radix, saliency_plane, scan,
    slot_sum, splat_outlines, stereo, subgroup_probe, tile_edges, tile_offsets, tile_ranges, tile_sort,
};
use crate::pass::{self, Pass};

/// A pass on the CPU: the pass's computation on raw buffers in binding order.
pub type TwinFn = fn(&mut TwinCall<'_>);

/// Every pass with its twin, in the order of [`pass::ALL`].
pub const TABLE: [(&Pass, TwinFn); 105] = [
    (&pass::adam::PASS, adam::run),
    (&pass::blend_backward::COLUMN_ATOMIC, blend_backward::run_column_sums),
    (&pass::blend_backward::COLUMN_CAS, blend_backward::run_column_sums),
    (&pass::blend_backward::COLUMN_EMULATED_SLOTS, blend_backward::run_column_slots),
    (&pass::blend_backward::COLUMN_SLOTS, blend_backward::run_column_slots),
    (&pass::blend_backward::PIXEL_ATOMIC, blend_backward::run_pixel_sums),
    (&pass::blend_backward::PIXEL_CAS, blend_backward::run_pixel_sums),
    (&pass::blend_backward::PIXEL_EMULATED_CAS, blend_backward::run_whole_sums),
    (&pass::blend_backward::PIXEL_EMULATED_SLOTS, blend_backward::run_whole_slots),
    (&pass::blend_backward::PIXEL_SLOTS, blend_backward::run_pixel_slots),
    (&pass::blend_forward::COLUMN, blend_forward::run_column),
    (&pass::blend_forward::COLUMN_EMULATED, blend_forward::run_column),
    (&pass::blend_forward::PIXEL, blend_forward::run_pixel),
    (&pass::compact::GATHER_COUNTS, compact::run_gather_counts),
    (&pass::compact::PASS, compact::run),
    (&pass::constrain::ADD, constrain::run_add),
    (&pass::constrain::KEEP, constrain::run_keep),
    (&pass::constrain::PASS, constrain::run),
    (&pass::convolution::PASS, convolution::run),
    (&pass::crop::GRADIENT, crop::run_gradient),
    (&pass::crop::PAIR, crop::run_pair),
    (&pass::densify_axes::PASS, densify_axes::run),
    (&pass::densify_classify::PASS, densify_classify::run),
    (&pass::densify_finish::PASS, densify_finish::run),
    (&pass::densify_gather::PASS, densify_gather::run),
    (&pass::densify_limit::PASS, densify_limit::run),
    (&pass::densify_map::PASS, densify_map::run),
    (&pass::densify_means::PASS, densify_means::run),
    (&pass::densify_order::BIRTHS, densify_order::run_births),
    (&pass::densify_order::CODES, densify_order::run_codes),
    (&pass::densify_order::FLAGS, densify_order::run_flags),
    (&pass::densify_order::ORDER, densify_order::run_order),
    (&pass::densify_sample::PASS, densify_sample::run),
    (&pass::densify_scores::PASS, densify_scores::run),
    (&pass::densify_stats::PASS, densify_stats::run),
    (&pass::densify_views::PASS, densify_views::run),
    (&pass::depth_probe::PASS, depth_probe::run),
    (&pass::emit::PASS, emit::run),
    (&pass::emit_tiles::EMULATED, emit_tiles::run),
    (&pass::emit_tiles::PASS, emit_tiles::run),
    (&pass::exposure::APPLY, exposure::run_apply),
    (&pass::exposure::BACKWARD, exposure::run_backward),
    (&pass::exposure::STEP, exposure::run_step),
    (&pass::feature_distance::PASS, feature_distance::run),
    (&pass::feature_distance::SUM, feature_distance::run_sum),
    (&pass::fill::PASS, fill::run),
    (&pass::finish::PASS, plan::run_finish),
    (&pass::geometry::DEPTH, geometry::run_depth),
    (&pass::geometry::GRAD, geometry::run_grad),
    (&pass::gradient_map::GRAD, gradient_map::run_grad),
    (&pass::gradient_map::SOBEL, gradient_map::run_sobel),
    (&pass::gradient_map::WINDOWS, gradient_map::run_windows),
    (&pass::loss::GRAD_APART, loss::run_grad_apart),
    (&pass::loss::GRAD_EMULATED, loss::run_grad_apart),
    (&pass::loss::GRAD_SUBGROUP, loss::run_grad),
    (&pass::loss::STRIPS_APART, loss::run_strips_apart),
    (&pass::loss::STRIPS_EMULATED, loss::run_strips_apart),
    (&pass::loss::STRIPS_SUBGROUP, loss::run_strips),
    (&pass::loss::SUM, loss::run_sum),
    (&pass::noise::PASS, noise::run),
    (&pass::opacity_reset::PASS, opacity_reset::run),
    (&pass::photograph_reduce::PASS, photograph_reduce::run),
    (&pass::part_sum::PASS, slot_sum::run_part_sum),
    (&pass::plan::PASS, plan::run),
    (&pass::pool::BACKWARD, pool::run_backward),
    (&pass::pool::FORWARD, pool::run),
    (&pass::probe::COPY, probe::copy),
    (&pass::probe::RATE, probe::rate),
    (&pass::project::HALF, project::run_half),
    (&pass::project::PASS, project::run),
    (&pass::project::SPARSE, project::run),
    (&pass::project_backward::PASS, project_backward::run),
    (&pass::project_backward_adam::PASS, project_backward_adam::run),
    (&pass::project_backward_adam_packed::PASS, project_backward_adam_packed::run),
    (&pass::radix::COUNT_GROUPS, radix::count_groups),
    (&pass::radix::COUNT_RUNS, radix::count_runs),
    (&pass::radix::ROWS, radix::rows),
    (&pass::radix::ROWS_EMULATED, radix::rows),
    (&pass::radix::SCATTER_GROUPS, radix::scatter_groups),
    (&pass::radix::SCATTER_GROUPS_EMULATED, radix::scatter_groups),
    (&pass::radix::SCATTER_RUNS, radix::scatter_runs),
    (&pass::scan::ADD, scan::add),
    (&pass::scan::ADD_EMULATED, scan::add),
    (&pass::scan::ONCE, scan::once),
    (&pass::scan::ONCE_RUNS, scan::once),
    (&pass::scan::ONCE_EMULATED, scan::once),
    (&pass::scan::REDUCE, scan::reduce),
    (&pass::scan::REDUCE_EMULATED, scan::reduce),
    (&pass::scan::SPINE, scan::spine),
    (&pass::scan::SPINE_EMULATED, scan::spine),
    (&pass::saliency_plane::PASS, saliency_plane::run),
    (&pass::slot_sum::PASS, slot_sum::run),
    (&pass::splat_outlines::PASS, splat_outlines::run),
    (&pass::stereo::BLOCKS, stereo::run_blocks),
    (&pass::stereo::FILTER, stereo::run_filter),
    (&pass::stereo::REFIT, stereo::run_refit),
    (&pass::stereo::SWEEP, stereo::run_sweep),
    (&pass::subgroup_probe::EMULATED, subgroup_probe::run),
    (&pass::subgroup_probe::SUBGROUP, subgroup_probe::run),
    (&pass::tile_edges::PASS, tile_edges::run),
    (&pass::tile_offsets::EMULATED, tile_offsets::run),
    (&pass::tile_offsets::PASS, tile_offsets::run),
    (&pass::tile_ranges::PASS, tile_ranges::run),
    (&pass::tile_sort::EMULATED, tile_sort::run),
    (&pass::tile_sort::PASS, tile_sort::run),
];

/// The twin of a pass; `None` for a pass that is not in [`pass::ALL`].
pub fn of(pass: &Pass) -> Option<TwinFn> {
    TABLE.iter().find(|(known, _)| known.kernel.name == pass.kernel.name).map(|(_, twin)| *twin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pass_has_one_twin() {
        let names = |passes: &[&Pass]| passes.iter().map(|pass| pass.kernel.name).collect::<Vec<_>>();
        assert_eq!(names(&TABLE.map(|(pass, _)| pass)), names(pass::ALL));
    }
}
