//! Every registered pass against its twin.
//!
//! A module per pass (or per family of passes) with `pub fn run(gpu: &Gpu)`, and a line in [`cases!`] with its kernels.
//! A kernel without a line fails [`every_pass_has_a_case`].

// Nothing of a test binary is reachable from outside.
#![allow(unreachable_pub)]

#[path = "../common/mod.rs"]
mod common;
mod harness;

mod adam;
mod blend_backward;
mod blend_forward;
mod blend_scene;
mod blend_twin;
mod convolution;
mod crop;
mod densify_order;
mod densify_passes;
mod densify_views;
mod density;
mod density_device;
mod density_model;
mod density_reference;
mod density_twin;
mod depth_probe;
mod emit;
mod exposure;
mod feature_distance;
mod geometry;
mod gradient_map;
mod lists_in_tiles;
mod loss;
mod noise;
mod photograph_reduce;
mod plain_rows;
mod plan;
mod pool;
mod probe;
mod project;
mod project_backward;
mod project_backward_adam;
mod project_backward_adam_packed;
mod projection_scene;
mod radix;
mod scan;
mod small;
mod splat_outlines;
mod ssim_table;
mod stereo;

use lists_in_tiles::{emit_tiles, tile_edges, tile_offsets, tile_sort};
use psrgs_vk::pass;
use small::{compact, constrain, fill, saliency_plane, slot_sum, subgroup_probe, tile_ranges};

macro_rules! cases {
    ($($module:ident: $($kernel:literal)+;)+) => {
        $(
            #[test]
            fn $module() {
                if let Some(gpu) = common::gpu() {
                    harness::each_way(&gpu, $module::run);
                    common::assert_no_messages(&gpu);
                }
            }
        )+
        const COVERED: &[&str] = &[$($($kernel),+),+];
    };
}

cases! {
    adam: "adam";
    blend_backward: "blend_backward_column_atomic" "blend_backward_column_cas" "blend_backward_column_emulated_slots"
        "blend_backward_column_slots" "blend_backward_pixel_atomic" "blend_backward_pixel_cas" "blend_backward_pixel_emulated_cas"
        "blend_backward_pixel_emulated_slots" "blend_backward_pixel_slots";
    blend_forward: "blend_forward_column" "blend_forward_column_emulated" "blend_forward_pixel";
    compact: "compact" "gather_counts";
    constrain: "constrain" "grad2d_add" "grad2d_keep";
    convolution: "convolution";
    crop: "crop_gradient" "crop_pair";
    densify_order: "densify_births" "densify_codes" "densify_flags" "densify_order";
    densify_passes: "densify_axes" "densify_classify" "densify_finish" "densify_gather" "densify_limit" "densify_map" "densify_means"
        "densify_sample" "densify_scores" "densify_stats" "opacity_reset";
    densify_views: "densify_views";
    depth_probe: "depth_probe";
    emit: "emit";
    emit_tiles: "emit_tiles_emulated" "emit_tiles_subgroup";
    exposure: "exposure_apply" "exposure_backward" "exposure_step";
    feature_distance: "feature_distance" "distance_sum";
    fill: "fill";
    geometry: "geometry_depth" "geometry_grad" "part_sum";
    gradient_map: "gradient_map_grad" "gradient_map_sobel" "gradient_map_windows";
    loss: "loss_grad_apart" "loss_grad_emulated" "loss_grad_subgroup" "loss_strips_apart" "loss_strips_emulated"
        "loss_strips_subgroup" "loss_sum";
    noise: "noise";
    photograph_reduce: "photograph_reduce";
    plan: "plan" "finish";
    pool: "pool" "pool_backward";
    probe: "probe_copy" "probe_rate";
    project: "project" "project_half" "project_sparse";
    project_backward: "project_backward";
    project_backward_adam: "project_backward_adam";
    project_backward_adam_packed: "project_backward_adam_packed";
    radix: "radix_count_runs" "radix_count_groups" "radix_scatter_runs" "radix_scatter_groups"
        "radix_scatter_groups_emulated" "radix_rows_subgroup" "radix_rows_emulated";
    saliency_plane: "saliency_plane";
    scan: "scan_reduce_subgroup" "scan_spine_subgroup" "scan_add_subgroup" "scan_reduce_emulated" "scan_spine_emulated"
        "scan_add_emulated" "scan_once_runs" "scan_once_subgroup"
        "scan_once_emulated";
    slot_sum: "slot_sum";
    splat_outlines: "splat_outlines";
    stereo: "stereo_blocks" "stereo_filter" "stereo_refit" "stereo_sweep";
    subgroup_probe: "subgroup_probe_subgroup" "subgroup_probe_emulated";
    tile_edges: "tile_edges";
    tile_offsets: "tile_offsets_emulated" "tile_offsets_subgroup";
    tile_ranges: "tile_ranges";
    tile_sort: "tile_sort_emulated" "tile_sort_subgroup";
}

#[test]
fn every_pass_has_a_case() {
    let registered: Vec<&str> = pass::ALL.iter().map(|pass| pass.kernel.name).collect();
    let without: Vec<_> = registered.iter().filter(|name| !COVERED.contains(name)).collect();
    assert!(without.is_empty(), "passes without a twin test: {without:?}");
    let unknown: Vec<_> = COVERED.iter().filter(|name| !registered.contains(name)).collect();
    assert!(unknown.is_empty(), "tests of passes that are not registered: {unknown:?}");
}

/// Runs cases under GPU-assisted validation, which checks each access by address against all buffers.
fn within_buffers(cases: &[fn(&psrgs_vk::vk::Gpu)]) {
    let assisted = |options: &mut psrgs_vk::vk::OpenOptions| {
        options.validation = psrgs_vk::vk::Validation::GpuAssisted;
        // Guards would extend the buffers.
        options.canaries = false;
    };
    let Some(gpu) = common::gpu_with(assisted) else { return };
    for case in cases {
        harness::each_way(&gpu, *case);
        common::assert_no_messages(&gpu);
    }
    assert!(gpu.stats().by_address > 0);
}

/// Cases that older layers handle. After a loop without an iteration around an access, layer 1.3.239 on Mesa 22.3
/// reports addresses that lie in their buffer (`plan`, `slot_sum`, `emit`, `scan`). Its shaders are up to a hundred
/// times slower.
#[test]
fn addresses_lie_in_their_buffers() {
    within_buffers(&[adam::run, compact::run, exposure::run, fill::run, pool::run, tile_ranges::run]);
}

/// Without the image loss and the backward blending, whose checks for races take more than twenty minutes. Trainings in
/// every form under validation include them.
#[test]
#[ignore = "minutes"]
fn addresses_of_more_passes_lie_in_their_buffers() {
    if !common::layer_assists() {
        return;
    }
    within_buffers(&[
        blend_forward::run,
        constrain::run,
        convolution::run,
        crop::run,
        densify_order::run,
        densify_passes::run,
        densify_views::run,
        depth_probe::run,
        emit::run,
        emit_tiles::run,
        feature_distance::run,
        geometry::run,
        gradient_map::run,
        noise::run,
        photograph_reduce::run,
        plan::run,
        probe::run,
        project::run,
        project_backward::run,
        project_backward_adam::run,
        project_backward_adam_packed::run,
        radix::run,
        saliency_plane::run,
        scan::run,
        slot_sum::run,
        splat_outlines::run,
        stereo::run,
        subgroup_probe::run,
        tile_edges::run,
        tile_offsets::run,
        tile_sort::run,
    ]);
}

/// Cases that take seconds on SwiftShader and keep their bounds there.
const ON_SWIFTSHADER: [&str; 24] = [
    "adam",
    "compact",
    "constrain",
    "convolution",
    "crop",
    "densify_order",
    "densify_passes",
    "densify_views",
    "exposure",
    "feature_distance",
    "fill",
    "geometry",
    "gradient_map",
    "photograph_reduce",
    "plan",
    "pool",
    "probe",
    "project",
    "project_backward",
    "saliency_plane",
    "slot_sum",
    "stereo",
    "tile_ranges",
    "blend_forward",
];

#[test]
fn small_passes_agree_with_their_twins_on_swiftshader() {
    let Some(driver) = common::swiftshader::swiftshader() else { return };
    let mut cases = std::process::Command::new(std::env::current_exe().unwrap());
    cases.arg("--exact").args(ON_SWIFTSHADER);
    let (good, said) = common::swiftshader::on_swiftshader(&driver, &cases);
    let ran = format!("{} passed", ON_SWIFTSHADER.len());
    assert!(good && said.contains(&ran), "{said}");
}
