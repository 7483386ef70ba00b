//! Benchmarks report live scenes and refuse dead ones.

mod common;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use common::plane_scene;
use psrgs_vk::bench::{self, Error, Options, Report};
use psrgs_vk::format::ply;
use psrgs_vk::pass;
use psrgs_vk::raster::TileShape;
use psrgs_vk::scene::{Frame, Gaussians};
use psrgs_vk::train::{Input, Settings};
use psrgs_vk::vk::Gpu;
use psrgs_vk::world::{self, WorldParams};

fn settings() -> Settings {
    let mut settings = Settings::default();
    settings.run.deterministic = true;
    settings
}

fn options(warm_up: u32, steps: u32) -> Options {
    Options { warm_up, steps, side: None, copy_bytes: 4 << 20 }
}

fn measure(gpu: &Gpu, input: Input) -> Result<Report, Error> {
    bench::measure(gpu, input, &settings(), &options(5, 7))
}

/// Checks that hold for every report.
fn assert_live(report: &Report) {
    let w = &report.workload;
    assert!(w.visible > 0.0 && w.visible <= f64::from(w.splats) && w.pairs >= w.visible, "{w:?}");
    let p = w.splats_per_pixel.expect("few enough to count");
    assert!(p.forward_blended > 0.0 && p.forward_evaluated >= p.forward_blended, "{p:?}");
    assert!(p.backward_blended > 0.0 && p.backward_evaluated >= p.backward_blended, "{p:?}");
    // Every blended splat gets a gradient, and the backward pass begins at the last blended splat.
    assert_eq!(p.forward_blended, p.backward_blended);
    // In pixel tiles each pass leaves out splats that do not show in its own blocks of pixels.
    let culled = report.variants.tile == TileShape::Pixel;
    assert!(culled || p.backward_evaluated <= p.forward_evaluated, "{p:?}");
    assert!(report.loss.last_pass < report.loss.first_pass);

    let close = |a: f64, b: f64| (a - b).abs() <= 1e-9 * b.abs();
    assert!(close(report.passes.iter().map(|p| p.share).sum(), 1.0));
    assert!(close(report.stages.iter().map(|s| s.share).sum(), 1.0));
    for (name, ms) in report.passes.iter().map(|p| (p.pass.as_str(), p.ms)).chain([("wall", report.wall_ms)]) {
        assert!(0.0 <= ms.q1 && ms.q1 <= ms.median && ms.median <= ms.q3, "{name}: {ms:?}");
    }
    let small = ["plan", "finish", "loss_sum", "copy"];
    let mut transfers = 0.0;
    for row in &report.passes {
        let known = pass::ALL.iter().any(|pass| pass.kernel.name == row.pass);
        transfers += if known { 0.0 } else { row.calls };
        assert!(known || ["clear", "copy"].contains(&row.pass.as_str()), "{} is no pass", row.pass);
        assert_eq!(row.bytes.is_none(), small.contains(&row.pass.as_str()), "bytes of {}", row.pass);
        assert_eq!(row.stage == "bookkeeping", ["plan", "finish", "copy", "clear"].contains(&row.pass.as_str()));
    }
    let rates = &report.rates;
    let rates = [rates.copy_kernel_gb_per_s, rates.copy_buffer_gb_per_s, rates.gops_per_s, rates.gexp2_per_s];
    assert!(rates.iter().all(|rate| *rate > 0.0 && rate.is_finite()), "{rates:?}");
    for row in &report.passes {
        let (name, floors) = (&row.pass, &row.floors);
        assert_eq!(floors.bytes_ms.is_some(), row.bytes.is_some(), "{name}");
        if let (Some(floor), Some(bytes)) = (floors.bytes_ms, row.bytes) {
            assert!(close(floor * report.rates.bandwidth(), 1e3 * bytes), "{name}");
        }
        let counted = ["blend", "loss_strips", "loss_grad", "project", "adam", "slot_sum"];
        assert!(floors.arithmetic_ms.is_none() || counted.iter().any(|of| name.starts_with(of)), "{name}");
        assert_eq!(row.over_floor, floors.larger().map(|floor| row.ms.median / floor), "{name}");
    }
    let blend = |name: &str| report.passes.iter().find(|p| p.pass.starts_with(name)).expect("a blending pass");
    // Operations per evaluation beside the exponential, and more per blended splat. Which of the two floors is larger
    // depends on the measured rates, which scatter on a busy machine.
    let floor = |evaluated: f64, blended: f64, each: f64, more: f64| {
        1e-6 * w.pixels
            * ((each * evaluated + more * blended) / report.rates.gops_per_s + evaluated / report.rates.gexp2_per_s)
    };
    let forward = floor(p.forward_evaluated, p.forward_blended, 10.0, 13.0);
    let backward = floor(p.backward_evaluated, p.backward_blended, 11.0, 35.0);
    assert!(close(blend("blend_forward").floors.arithmetic_ms.expect("a floor"), forward));
    assert!(close(blend("blend_backward").floors.arithmetic_ms.expect("a floor"), backward));
    let host = &report.per_step;
    let dispatches: f64 = report.passes.iter().map(|p| p.calls).sum::<f64>() - transfers;
    assert_eq!((host.dispatches, host.transfers), (dispatches, transfers), "timed are other commands than submitted");
    assert_eq!((host.submits, host.host_waits, host.pacing_waits), (1.0, 0.0, 1.0));
    assert!(host.barriers > 0.0 && host.buffer_barriers >= host.barriers);
}

#[test]
fn a_live_scene_is_reported() {
    let Some(gpu) = common::gpu() else { return };
    let report = measure(&gpu, plane_scene::input(6, 64, 48, 300)).expect("live");
    assert_live(&report);
    assert_eq!((report.workload.splats, report.workload.views, report.workload.size), (300, 6, [64, 48]));
    assert_eq!(report.workload.pixels, 64.0 * 48.0);
    // The step reads and writes each of 59 parameters with its two moments,
    // and reads 17 more floats of a splat on screen.
    let pass =
        |report: &Report, name| report.passes.iter().find(|p| p.pass == name).map(|p| (p.bytes.unwrap(), p.calls));
    let bytes = 300.0 * (4.0 + 59.0 * 24.0) + 64.0 * report.workload.visible;
    assert_eq!(pass(&report, "project_backward_adam"), Some((bytes, 1.0)));
    assert_eq!(pass(&report, "adam"), None);
}

/// A device that binds fewer buffers to a pass has gradients in memory between two passes.
#[test]
fn the_optimiser_falls_back_to_gradients_in_memory() {
    let Some(gpu) = common::gpu_with(|o| o.max_storage_buffers = Some(24)) else { return };
    let report = measure(&gpu, plane_scene::input(6, 64, 48, 300)).expect("live");
    assert_live(&report);
    // Adam reads four and writes three floats of each of 59 parameters.
    let adam = report.passes.iter().find(|p| p.pass == "adam").expect("an optimiser step");
    assert_eq!((adam.bytes, adam.calls), (Some(300.0 * 59.0 * 28.0), 8.0));
    assert!(report.passes.iter().any(|p| p.pass == "project_backward"));
    assert!(report.passes.iter().all(|p| p.pass != "project_backward_adam"));
}

#[test]
fn few_views_are_spread_over_all() {
    let Some(gpu) = common::gpu() else { return };
    let mut input = plane_scene::input(20, 40, 30, 200);
    // Only the views that are expected to be taken have this size.
    let large = |i: usize| [2, 4, 7, 9, 12, 14, 17, 19].contains(&i);
    let small = plane_scene::input(20, 20, 15, 0).train;
    for (i, view) in input.train.iter_mut().enumerate().filter(|(i, _)| !large(*i)) {
        *view = small[i].clone();
    }
    let report = measure(&gpu, input).expect("live");
    assert_eq!((report.workload.views, report.workload.pixels), (8, 1200.0));
}

#[test]
fn steps_before_a_buffer_grows_are_not_measured() {
    let Some(gpu) = common::gpu() else { return };
    let mut input = plane_scene::input(4, 64, 48, 300);
    // Every splat lies on all 48 tiles: more than the eight pairs per splat of the first allocation.
    input.initial.scales.fill(1.0);
    let report = measure(&gpu, input).expect("live");
    assert!(report.workload.pairs > 8.0 * 300.0, "{} pairs", report.workload.pairs);
    assert_live(&report);
}

#[test]
fn what_is_not_live_is_refused() {
    let Some(gpu) = common::gpu() else { return };
    let refused = |what: &str, input: Input, settings: &Settings, word: &str| {
        let error = bench::measure(&gpu, input, settings, &options(2, 4)).expect_err(what);
        assert!(matches!(&error, Error::NotLive(why) if why.contains(word)), "{what}: {error}");
    };
    let mut behind = plane_scene::splats(50);
    behind.means.chunks_exact_mut(3).for_each(|p| p[2] = 100.0);
    refused("behind", Input { initial: behind, ..plane_scene::input(3, 40, 30, 0) }, &settings(), "visible");
    let none = Input { initial: Gaussians::zeros(0), ..plane_scene::input(3, 40, 30, 0) };
    refused("none", none, &settings(), "visible");
    let mut frozen = settings();
    let rates = &mut frozen.optimiser;
    (rates.lr_means, rates.lr_means_final, rates.lr_scales, rates.lr_rotations) = (1e-30, 1e-30, 0.0, 0.0);
    (rates.lr_opacities, rates.lr_sh_base, rates.lr_sh_rest) = (0.0, 0.0, 0.0);
    refused("frozen", plane_scene::input(3, 40, 30, 100), &frozen, "loss");
}

/// A tiny dataset in a folder.
fn dataset(folder: &Path) -> PathBuf {
    let data = folder.join("world");
    let params = WorldParams {
        images: 8,
        max_side: 64,
        supersample: 1,
        pixels_per_point: 10,
        offpath: 0,
        ..WorldParams::default()
    };
    world::generate(&params, &data, &mut |_| ()).expect("a world");
    data
}

fn psrgs(data: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_psrgs-vk"));
    command.arg("bench").arg(data).args(["--warm-up", "6", "--steps", "7"]).args(args).output().expect("it starts")
}

#[test]
fn the_command_writes_json_and_a_table_and_passes_validation() {
    if common::gpu().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let data = dataset(folder.path());
    let file = folder.path().join("bench.json");
    let json = file.to_str().expect("UTF-8");
    let output = psrgs(&data, &["--splats", "1500", "--validate", "--json", json]);
    let (out, said) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{said}");
    for word in
        ["1,500 splats", "0 host waits", "project_backward_adam", "blend backward", "wall", "x floor", "exponentials"]
    {
        assert!(out.contains(word), "no `{word}` in:\n{out}");
    }
    let text = std::fs::read_to_string(&file).expect("the JSON");
    let made: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    for key in [
        "command",
        "version",
        "commit",
        "debug_assertions",
        "device",
        "variants",
        "rates",
        "warm_up",
        "steps",
        "workload",
        "loss",
        "device_ms",
        "wall_ms",
        "per_step",
        "passes",
        "stages",
        "peak_device_bytes",
        "memory",
        "density_peak_bytes",
    ] {
        assert!(made.get(key).is_some(), "no {key} in {text}");
    }
    assert_eq!(made["validated"], true);
    assert_eq!(made["workload"]["splats"], 1500);
    assert!(made["passes"][0]["floors"].get("bytes_ms").is_some() && made["passes"][0].get("over_floor").is_some());
    assert_eq!(made["per_step"]["host_waits"], 0.0);
    assert!(made["command"].as_str().is_some_and(|c| c.starts_with("psrgs-vk bench") && c.contains("--validate")));
}

#[test]
fn the_command_refuses_a_dead_scene_with_code_7() {
    if common::gpu().is_none() {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let data = dataset(folder.path());
    // High above cameras that all look down.
    let mut splats = plane_scene::splats(50);
    splats.means.chunks_exact_mut(3).for_each(|p| p[2] = 1e5);
    let (model, json) = (folder.path().join("dead.ply"), folder.path().join("dead.json"));
    ply::save(&model, &splats, &Frame::IDENTITY, false).expect("a model");
    let paths = [&model, &json].map(|path| path.to_str().expect("UTF-8"));
    let output = psrgs(&data, &["--init", paths[0], "--json", paths[1]]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(7), "{said}");
    assert!(said.contains("not live") && output.stdout.is_empty() && !json.exists(), "{said}");
}

#[test]
fn pictures_larger_than_the_photographs_are_made() {
    let Some(gpu) = common::gpu() else { return };
    let options = Options { side: Some(128), ..options(5, 7) };
    let report = bench::measure(&gpu, plane_scene::input(3, 64, 48, 300), &settings(), &options).expect("live");
    assert_eq!((report.workload.size, report.workload.pixels), ([128, 96], 128.0 * 96.0));
    assert_live(&report);
}

#[test]
fn commands_of_a_step_say_what_they_wait_for() {
    let Some(gpu) = common::gpu() else { return };
    let listed =
        bench::commands(&gpu, plane_scene::input(3, 64, 48, 300), &settings(), &options(2, 4)).expect("a step");
    assert_eq!(listed.last().expect("commands").command, "read by the host");
    let mut barriers = 0;
    for (i, command) in listed.iter().enumerate() {
        barriers += usize::from(command.barrier);
        for wait in &command.waits {
            let mine = |names: &[String]| names.contains(&wait.buffer);
            assert!(mine(&command.reads) || mine(&command.writes), "{i}: {command:?}");
            let Some(after) = wait.after else { continue };
            let other = &listed[after];
            assert!(after < i && (other.writes.contains(&wait.buffer) || mine(&command.writes)), "{i}: {command:?}");
            // A barrier stands between the two commands.
            assert!(listed[after + 1..=i].iter().any(|between| between.barrier), "{i}: {command:?}");
        }
    }
    let waiting = listed.iter().filter(|command| !command.waits.is_empty()).count();
    assert!(barriers > 10 && barriers <= waiting, "{barriers} barriers for {waiting} commands that wait");
    // Each pass of the tile lists is listed.
    for pass in ["project", "compact", "emit", "tile_ranges", "finish"] {
        // Some passes have a name per variant, and lists that are sorted in tiles have other passes.
        let is = |name: &str| {
            name == pass
                || pass == "emit" && name.starts_with("emit_tiles")
                || pass == "tile_ranges" && name.starts_with("tile_offsets")
                || pass == "project" && name == "project_sparse"
        };
        assert!(listed.iter().any(|command| is(&command.command)), "no {pass}");
    }
}

#[test]
fn keys_are_sorted_and_counted() {
    let Some(gpu) = common::gpu() else { return };
    for (keys, bits) in [(1, 32), (20_000, 32), (5000, 13)] {
        let report = bench::sort(&gpu, keys, bits, 2).expect("sorted");
        assert_eq!((report.keys, report.bits), (keys, bits));
        assert!(report.gkeys_per_s > 0.0 && report.dispatches >= 3);
    }
}
