//! The command line as a user meets it: help, settings, exit codes.

#[path = "common/skips.rs"]
mod skips;

use std::path::Path;
use std::process::{Command, Output};

fn psrgs(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_psrgs-vk"))
        .args(args)
        .env_remove("PSRGS_DEVICE")
        .output()
        .expect("the command starts")
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("UTF-8")
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).expect("UTF-8")
}

/// The settings that `train` would use.
fn settings(args: &[&str]) -> toml::Table {
    let output = psrgs(&[&["train", "--print-settings"], args].concat());
    assert!(output.status.success(), "{args:?}: {}", stderr(&output));
    stdout(&output).parse().expect("a settings file")
}

fn fails(args: &[&str], code: i32, words: &[&str]) {
    let output = psrgs(args);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{args:?}: {said}");
    for word in words {
        assert!(said.contains(word), "{args:?} does not say `{word}`: {said}");
    }
}

fn write(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("a temporary file");
    path.to_str().expect("UTF-8").to_owned()
}

/// File names come from strangers: control characters in them are escaped.
#[cfg(unix)]
#[test]
fn names_with_escape_sequences_are_spelled_in_messages() {
    let root = tempfile::tempdir().expect("temporary folder");
    let name = "a\u{1b}]0;title\u{7}\u{202e}gpj\r\npsrgs-vk: all is well";
    let inside = root.path().join(name);
    std::fs::create_dir_all(inside.join("more")).expect("folder");
    let out = root.path().join("out");
    for args in [
        ["train", inside.to_str().expect("text"), "--out", out.to_str().expect("text")],
        ["train", "x", "--split", name],
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_psrgs-vk")).args(args).output().expect("a process");
        let said = String::from_utf8(output.stderr).expect("text");
        // The parser of arguments strips escape sequences from wrong values.
        assert!(said.contains("\\u202egpj\\u000d"), "{said}");
        assert!(args[1] == "x" || said.contains("\\u001b]0;title\\u0007"), "{said}");
        assert!(!said.contains(['\u{1b}', '\u{7}', '\u{202e}', '\r']), "{said:?}");
        assert_eq!(said.lines().filter(|line| line.starts_with("psrgs-vk:")).count(), 1, "{said}");
    }
}

#[test]
fn forgotten_units_and_splits_that_leave_nothing_are_told() {
    fails(&["train", "x", "--out", "y", "--max-device-memory", "8"], 2, &["8 bytes", "8GiB"]);
    fails(&["train", "x", "--out", "y", "--split", "every:1"], 2, &["every:1", "every:8", "none to train on"]);
}

#[test]
fn every_command_explains_itself() {
    let help = psrgs(&["--help"]);
    assert!(help.status.success());
    for command in ["train", "render", "eval", "demo", "bench", "info", "passes", "completions"] {
        assert!(stdout(&help).contains(command), "--help does not name {command}");
        let own = psrgs(&[command, "--help"]);
        assert!(own.status.success() && stdout(&own).contains("Usage: psrgs-vk"), "{command}");
    }
    let train = stdout(&psrgs(&["train", "--help"]));
    for heading in ["Most used:", "Run:", "Photographs:", "Model:", "Growth:", "Machine:", "Examples:"] {
        assert!(train.contains(heading), "train --help has no {heading}");
    }
}

#[test]
fn option_names_that_scripts_rely_on_exist() {
    let help = |command: &str| stdout(&psrgs(&[command, "--help"]));
    let train = help("train");
    for option in
        "out method iterations scale-schedule max-side seed deterministic no-densify init checkpoint-every config \
                   device resume"
            .split_whitespace()
    {
        assert!(train.contains(&format!("--{option}")), "train has no --{option}");
    }
    let bench = help("bench");
    for option in ["max-side", "init", "validate", "json"] {
        assert!(bench.contains(&format!("--{option}")), "bench has no --{option}");
    }
    assert!(help("render").contains("--cameras") && help("demo").contains("--out"));
}

#[test]
fn named_options_win_over_the_file_and_the_file_over_defaults() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = write(
        folder.path(),
        "my.toml",
        "data = \"fox\"\n[run]\niterations = 1500\nseed = 7\nscale-schedule = true\n[device]\ndevice = \"llvmpipe\"\n",
    );
    let got = settings(&["--config", &file, "--iterations", "30000", "--scale-schedule=false"]);
    assert_eq!(got["run"]["iterations"].as_integer(), Some(30_000), "named, though it is the default");
    assert_eq!(got["run"]["seed"].as_integer(), Some(7));
    assert_eq!(got["run"]["scale-schedule"].as_bool(), Some(false));
    assert_eq!(got["device"]["device"].as_str(), Some("llvmpipe"));
    assert_eq!(got["photographs"]["max-side"].as_integer(), Some(1600));
    assert!(got["data"].as_str().is_some_and(|d| d.starts_with('/') && d.ends_with("/fox")), "{}", got["data"]);
}

#[test]
fn psrgs_is_the_method_where_none_is_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let chosen = |args: &[&str]| {
        let got = settings(args);
        let word = |group: &str, key: &str| got[group][key].as_str().expect("a word").to_owned();
        (word("run", "method"), word("density", "growth"), word("geometry", "depth-prior"))
    };
    let is = |method: &str, growth: &str, prior: &str| (method.to_owned(), growth.to_owned(), prior.to_owned());
    let best = is("psrgs", "sampled", "stereo");
    assert_eq!(chosen(&["fox"]), best);
    assert_eq!(chosen(&["fox", "--method", "3dgs"]), is("3dgs", "threshold", "none"));
    assert_eq!(chosen(&["fox", "--set", "growth=threshold"]).1, "threshold", "options by name win over the method");
    let silent = write(folder.path(), "silent.toml", "[run]\nseed = 3\n");
    assert_eq!(chosen(&["fox", "--config", &silent]), best);
    let named = write(folder.path(), "named.toml", "[run]\nmethod = \"3dgs\"\n");
    assert_eq!(chosen(&["fox", "--config", &named]).0, "3dgs");
}

#[test]
fn start_and_housekeeping_are_options_of_every_method() {
    let chosen = |args: &[&str]| {
        let got = settings(&[&["fox"], args].concat());
        let start = got["geometry"]["start"].as_str().expect("a word").to_owned();
        let resets = got["density"]["opacity-reset-interval"].as_integer().expect("a number");
        (start, got["geometry"]["stereo-splats"].as_integer().expect("a number"), resets)
    };
    let is = |start: &str, splats: i64, resets: i64| (start.to_owned(), splats, resets);
    assert_eq!(chosen(&[]), is("stereo", 0, 0));
    assert_eq!(chosen(&["--method", "psrgs-paper"]), is("sfm", 0, 3000));
    assert_eq!(chosen(&["--method", "3dgs"]), is("sfm", 0, 3000));
    for method in ["3dgs", "absgs", "gspro", "lean", "psrgs", "psrgs-paper"] {
        let asked = ["--method", method, "--start", "stereo", "--housekeeping", "lean"];
        assert_eq!(chosen(&asked), is("stereo", 0, 0), "{method}");
        assert_eq!(chosen(&["--method", method, "--start", "sfm"]).0, "sfm", "{method}");
        assert_eq!(chosen(&["--method", method, "--housekeeping", "published"]).2, 3000, "{method}");
    }
    let mcmc = ["--method", "mcmc", "--start", "stereo", "--housekeeping", "lean"];
    assert_eq!(chosen(&mcmc), is("stereo", 0, 0), "without resets as published");
    let named = ["--housekeeping", "lean", "--opacity-reset-interval", "500", "--set", "stereo-splats=60000"];
    assert_eq!(chosen(&named), is("stereo", 60_000, 500), "named settings win");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = write(folder.path(), "run.toml", "[geometry]\nstereo-splats = 30000\n");
    assert_eq!(chosen(&["--config", &file]).1, 30_000);
    assert_eq!(chosen(&["--config", &file, "--set", "stereo-splats=0"]).1, 0);
    fails(&["train", "fox", "--method", "3dgs", "--set", "stereo-splats=5"], 2, &["stereo-splats", "start"]);
    fails(&["train", "fox", "--set", "stereo-density=5"], 2, &["stereo-density", "stereo-splats"]);
}

/// Longer side, steps, and whether the schedule is scaled.
fn size_and_steps(settings: &toml::Table) -> (i64, i64, bool) {
    let number = |group: &str, key: &str| settings[group][key].as_integer().expect("a number");
    let scaled = settings["run"]["scale-schedule"].as_bool().expect("a truth");
    (number("photographs", "max-side"), number("run", "iterations"), scaled)
}

#[test]
fn presets_are_written_out_and_named_options_win_over_them() {
    let chosen = |args: &[&str]| size_and_steps(&settings(&[&["fox"], args].concat()));
    assert_eq!(chosen(&["--preset", "quick"]), (640, 2000, true));
    assert_eq!(chosen(&["--preset", "standard"]), (1600, 30_000, false));
    assert_eq!(chosen(&["--preset", "full"]), (65_536, 30_000, false));
    assert_eq!(chosen(&["--preset", "quick", "--max-side", "320", "--scale-schedule=false"]), (320, 2000, false));
    assert_eq!(chosen(&["--preset", "quick", "--iterations", "700"]), (640, 700, true));
    fails(&["train", "fox", "--preset", "slow"], 2, &["quick, standard or full"]);
    // Without `--preset`, the device decides the preset. With size and steps named, the device changes nothing.
    assert_eq!(chosen(&["--max-side", "1234", "--iterations", "30000"]), (1234, 30_000, false));
    let kind = psrgs_vk::vk::device_kind(None).ok();
    let quick = kind == Some(psrgs_vk::vk::DeviceKind::Cpu);
    assert_eq!(chosen(&[]), if quick { (640, 2000, true) } else { (1600, 30_000, false) });
    let side = if quick { 640 } else { 1600 };
    for method in ["3dgs", "mcmc"] {
        let got = chosen(&["--method", method, "--iterations", "7000"]);
        assert_eq!(got, (side, 7000, false), "{method} does not scale its schedule");
    }
    // A scaled schedule still has steps for growth, pruning and the skirt.
    for method in ["lean", "psrgs", "psrgs-paper"] {
        assert_eq!(chosen(&["--method", method, "--iterations", "7000"]), (side, 7000, true), "{method}");
        assert_eq!(chosen(&["--method", method, "--iterations", "30000"]), (side, 30_000, false), "{method}");
    }
    assert_eq!(chosen(&["--iterations", "7000", "--scale-schedule=false"]), (side, 7000, false));
    assert_eq!(chosen(&["--iterations", "7000", "--densify-until", "3000"]), (side, 7000, false), "that is step 3,000");
    assert_eq!(chosen(&["--preset", "full", "--iterations", "7000"]), (65_536, 7000, true));
}

#[test]
fn steps_are_by_need_unless_they_or_their_schedule_are_named() {
    let looks =
        |args: &[&str]| settings(&[&["fox"], args].concat())["run"].get("looks").and_then(toml::Value::as_integer);
    for method in ["lean", "psrgs", "psrgs-paper"] {
        assert_eq!(looks(&["--method", method]), Some(150), "{method}");
        assert_eq!(looks(&["--method", method, "--max-side", "320", "--seed", "4"]), Some(150), "{method}");
        let named: [&[&str]; 6] = [
            &["--iterations", "30000"],
            &["--set", "iterations=900"],
            &["--preset", "quick"],
            &["--densify-until", "3000"],
            &["--scale-schedule=false"],
            &["--set", "looks=20", "--iterations", "900"],
        ];
        for args in named {
            assert_eq!(looks(&[&["--method", method], args].concat()), None, "{method} {args:?}");
        }
    }
    for method in ["3dgs", "absgs", "gspro"] {
        assert_eq!(looks(&["--method", method]), None, "{method}");
        assert_eq!(looks(&["--method", method, "--set", "looks=20"]), Some(20), "{method}");
    }
    assert_eq!(looks(&["--set", "looks=20"]), Some(20));
    fails(&["train", "fox", "--set", "looks=0"], 2, &["looks must be at least 1"]);
    // Of a file: steps that are written there stay, and what was printed before they were chosen is chosen again.
    let folder = tempfile::tempdir().expect("a temporary folder");
    let of = |text: &str, args: &[&str]| {
        let file = write(folder.path(), "my.toml", text);
        looks(&[&["--config", &file], args].concat())
    };
    assert_eq!(of("[run]\nmethod = \"psrgs\"\n", &[]), Some(150));
    assert_eq!(of("[run]\nmethod = \"psrgs\"\niterations = 4200\nscale-schedule = true\n", &[]), None);
    assert_eq!(of("[run]\nmethod = \"psrgs\"\npreset = \"quick\"\n", &[]), None);
    let printed = toml::to_string(&settings(&["fox", "--seed", "3"])).expect("text");
    assert_eq!(of(&printed, &[]), Some(150));
    assert_eq!(of(&printed, &["--iterations", "7000"]), None);
    assert_eq!(of(&printed, &["--preset", "standard"]), None);
}

#[test]
fn a_settings_file_is_complete_and_a_preset_option_overrides_it() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let chosen = |text: &str, args: &[&str]| {
        let file = write(folder.path(), "my.toml", text);
        size_and_steps(&settings(&[&["fox", "--config", &file], args].concat()))
    };
    // Without a preset in the file, missing settings have their defaults on every device.
    assert_eq!(chosen("[run]\nseed = 3\n", &[]), (1600, 30_000, false));
    assert_eq!(chosen("[run]\npreset = \"quick\"\n", &[]), (640, 2000, true));
    let own = "[run]\npreset = \"quick\"\niterations = 900\n[photographs]\nmax-side = 500\n";
    assert_eq!(chosen(own, &[]), (500, 900, true));
    assert_eq!(chosen(own, &["--preset", "standard"]), (1600, 30_000, false));
    assert_eq!(chosen(own, &["--preset", "standard", "--max-side", "77"]), (77, 30_000, false));
    // Everything else of the file stays.
    let own = "[run]\nmethod = \"3dgs\"\n[optimiser]\nlambda-dssim = 0.11\n";
    let file = write(folder.path(), "my.toml", own);
    for preset in [&[][..], &["--preset", "quick"], &["--preset", "standard"]] {
        let got = settings(&[&["fox", "--config", &file], preset].concat());
        assert_eq!(got["run"]["method"].as_str(), Some("3dgs"), "{preset:?}");
        assert_eq!(got["optimiser"]["lambda-dssim"].as_float(), Some(0.11), "{preset:?}");
    }
}

#[test]
fn printed_settings_give_the_same_settings_again() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let args = [
        "fox",
        "--max-side",
        "320",
        "--no-densify",
        "--background",
        "white",
        "--max-splats",
        "500",
        "--lr-means",
        "3e-5",
    ];
    let first = psrgs(&[&["train", "--print-settings"], &args[..]].concat());
    let file = write(folder.path(), "settings.toml", &stdout(&first));
    let again = psrgs(&["train", "--print-settings", "--config", &file]);
    assert_eq!(stdout(&first), stdout(&again));
    assert!(stdout(&first).contains("max-splats = 500"));
}

#[test]
fn a_key_that_is_set_wins_over_method_and_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = write(folder.path(), "my.toml", "[density]\nsample-rate = 0.1\n[frequencies]\nlow-stage = 0.4\n");
    let values = |args: &[&str]| {
        let settings = settings(&[args, &["--method", "psrgs"]].concat());
        let value = |group: &str, key: &str| settings[group][key].as_float().expect("a number");
        [value("density", "sample-rate"), value("frequencies", "low-stage")]
    };
    assert_eq!(values(&["fox"]), [0.5, 0.25]);
    assert_eq!(values(&["fox", "--set", "low-stage=0.3", "--set", "sample-rate=0.2"]), [0.2, 0.3]);
    assert_eq!(values(&["fox", "--config", &file]), [0.1, 0.4]);
    assert_eq!(values(&["fox", "--config", &file, "--set", "low-stage=0.3"]), [0.1, 0.3]);
}

#[test]
fn a_key_that_is_set_wins_over_the_environment() {
    let mut program = Command::new(env!("CARGO_BIN_EXE_psrgs-vk"));
    program.args(["train", "fox", "--print-settings", "--set", "device=lavapipe"]).env("PSRGS_DEVICE", "elsewhere");
    let output = program.output().expect("the command starts");
    let settings: toml::Table = stdout(&output).parse().expect("a settings file");
    assert_eq!(settings["device"]["device"].as_str(), Some("lavapipe"), "{}", stderr(&output));
}

#[test]
fn unknown_keys_and_former_options_name_the_key_to_use() {
    fails(&["train", "fox", "--set", "sample-rat=1"], 2, &["sample-rat", "sample-rate"]);
    fails(&["train", "fox", "--set", "sample-rate=much"], 2, &["sample-rate", "much"]);
    fails(&["train", "fox", "--set", "sample-rate=2"], 2, &["sample-rate", "from 0 to 1"]);
    fails(&["train", "fox", "--sample-rate", "0.3"], 2, &["--set sample-rate=VALUE"]);
    fails(&["train", "fox", "--fast"], 2, &["--fast", "--moment-bits 16"]);
    fails(&["train", "fox", "--moment-bits", "24"], 2, &["moment-bits", "16 or 32"]);
    for gone in ["beta2-scaling", "coarse-spectrum", "prune-distance", "exponential"] {
        fails(&["train", "fox", &format!("--{gone}=1")], 2, &[gone, "leave it out"]);
        fails(&["train", "fox", "--set", &format!("{gone}=1")], 2, &[gone, "gone", "leave it out"]);
    }
    fails(&["render", "x.ply", "--cameras", "fox", "--iterations", "5"], 2, &["unexpected argument '--iterations'"]);
    fails(&["train", "fox", "--nonsense"], 2, &["--nonsense"]);
}

#[test]
fn help_of_train_fits_three_screens() {
    let program = Command::new(env!("CARGO_BIN_EXE_psrgs-vk")).args(["train", "--help"]).output().expect("help");
    let help = stdout(&program);
    let options = help.lines().filter(|line| line.trim_start().starts_with("--")).count();
    assert!(options <= 60, "{options} options");
    assert!(help.lines().count() <= 165, "{} lines", help.lines().count());
}

#[test]
fn wrong_settings_are_named_with_file_and_line() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = write(folder.path(), "my.toml", "[run]\nitertions = 1500\n");
    fails(&["train", "fox", "--config", &file], 2, &["my.toml:2", "itertions"]);
    fails(&["train", "fox", "--config", "/nowhere/my.toml"], 2, &["/nowhere/my.toml"]);
    fails(&["train", "fox", "--sh-degree", "4"], 2, &["sh-degree", "0, 1, 2 or 3"]);
}

#[test]
fn usage_errors_have_their_code_and_say_what_to_do() {
    fails(&["train"], 2, &["train DATA --out DIR"]);
    fails(&["train", "fox", "--itertions", "5"], 2, &["--iterations"]);
    fails(&["train", "fox", "--resume", "run", "--out", "other"], 2, &["--resume"]);
    fails(&["train", "fox", "--method", "gsplat"], 2, &["no method `gsplat`", "3dgs"]);
    fails(&["train", "fox", "--method", "nerf"], 2, &["3dgs"]);
    fails(&[], 2, &["Usage"]);
}

#[test]
fn resuming_what_is_not_there_is_an_input_error() {
    fails(&["train", "--resume", "/nowhere"], 3, &["/nowhere", "no run to resume"]);
}

#[test]
fn a_resumed_run_keeps_what_its_steps_depend_on() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let run = folder.path().to_str().expect("UTF-8");
    write(folder.path(), "settings.toml", "data = \"/fox\"\n[run]\nseed = 7\n");
    let got = settings(&["--resume", run, "--checkpoint-every", "50", "--seed", "7"]);
    assert_eq!(got["run"]["checkpoint-every"].as_integer(), Some(50));
    assert_eq!(got["run"]["seed"].as_integer(), Some(7));
    fails(&["train", "--resume", run, "--seed", "8"], 2, &["settings of the run"]);
    let moved = settings(&["/elsewhere/fox", "--resume", run]);
    assert_eq!(moved["data"].as_str(), Some("/elsewhere/fox"));
    fails(&["train", "--resume", run], 3, &["/fox", "train DATA --resume"]);
    write(folder.path(), "settings.toml", "data = \"/fox\"\n[run]\nscale-schedule = true\niterations = 1500\n");
    fails(&["train", "--resume", run, "--iterations", "3000"], 2, &["--scale-schedule"]);
    write(folder.path(), "settings.toml", "data = \"/fox\"\n[texture]\nlambda-perceptual = 0.1\n");
    fails(&["train", "--resume", run, "--perceptual-weights", "/elsewhere"], 2, &["settings of the run"]);
    // A path is the same however it is spelled.
    let here = std::env::current_dir().expect("a folder").join("weights");
    let text =
        format!("data = \"/fox\"\n[texture]\nlambda-perceptual = 0.1\n[scoring]\nperceptual-weights = {here:?}\n");
    write(folder.path(), "settings.toml", &text);
    settings(&["--resume", run, "--perceptual-weights", "weights"]);
}

#[test]
fn an_address_in_use_costs_nothing_of_an_earlier_run() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = write(folder.path(), "settings.toml", "");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = taken.local_addr().expect("an address").port().to_string();
    let out = folder.path().to_str().expect("UTF-8");
    fails(&["train", "fox", "--out", out, "--overwrite", "--view", &port], 2, &[&port, "in use"]);
    assert_eq!(std::fs::read_to_string(file).expect("it is still there"), "");
}

#[test]
fn passes_are_listed_as_registered() {
    let text = stdout(&psrgs(&["passes"]));
    let json: serde_json::Value = serde_json::from_str(&stdout(&psrgs(&["passes", "--json"]))).expect("JSON");
    let listed = json.as_array().expect("a list");
    assert_eq!(listed.len(), psrgs_vk::pass::ALL.len());
    for (got, pass) in listed.iter().zip(psrgs_vk::pass::ALL) {
        assert_eq!(got["name"], pass.kernel.name);
        assert_eq!(got["bindings"].as_array().map(Vec::len), Some(pass.kernel.bindings.len()));
        assert!(text.contains(pass.kernel.name));
    }
}

/// Software devices tell nothing of their pipelines; `registers_are_those_that_the_compilers_tell` asks drivers that do.
#[test]
fn statistics_are_told_or_refused_by_name() {
    let output = psrgs(&["passes", "--statistics", "--json"]);
    if output.status.success() {
        let json: serde_json::Value = serde_json::from_str(&stdout(&output)).expect("JSON");
        let passes = json["passes"].as_array().expect("a list");
        for family in ["project", "blend_forward", "blend_backward", "loss_grad", "project_backward_adam", "densify"] {
            let of_family = |pass: &serde_json::Value| pass["name"].as_str().is_some_and(|n| n.starts_with(family));
            assert!(passes.iter().any(of_family), "nothing of {family}");
        }
        let told = |pass: &serde_json::Value| pass["statistics"].as_object().is_some_and(|told| !told.is_empty());
        assert!(passes.iter().all(told), "a pass without statistics");
    } else if stderr(&output).contains("no Vulkan") {
        skips::skipped(stderr(&output));
    } else {
        fails(&["passes", "--statistics"], 4, &["VK_KHR_pipeline_executable_properties", "info"]);
    }
    fails(&["passes", "--device", "0"], 2, &["--statistics"]);
}

#[test]
fn completions_are_printed_for_every_shell() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let output = psrgs(&["completions", shell]);
        assert!(output.status.success() && stdout(&output).contains("scale-schedule"), "{shell}");
    }
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let status = Command::new("sh")
        .args(["-c", &format!("{{ {} completions zsh; echo $? >&2; }} | head -c 1", env!("CARGO_BIN_EXE_psrgs-vk"))])
        .output()
        .expect("sh starts");
    assert_eq!(stderr(&status).trim(), "0");
}

#[test]
fn devices_are_described_and_a_wrong_one_has_its_code() {
    let info = psrgs(&["info", "--json"]);
    if info.status.code() == Some(4) {
        skips::skipped(format_args!("no Vulkan device ({})", stderr(&info).trim()));
        return;
    }
    let json: serde_json::Value = serde_json::from_str(&stdout(&info)).expect("JSON");
    let used = json["in_use"]["name"].as_str().expect("a device in use");
    assert!(json["devices"].as_array().expect("devices").iter().any(|d| d["name"] == used));
    assert!(stdout(&psrgs(&["info"])).contains(used));
    fails(&["info", "--device", "no such device"], 4, &["no such device", used]);
}

#[test]
fn variables_that_cannot_be_read_are_named() {
    for args in [&["info"][..], &["train", "fox", "--print-settings"], &["check", "fox"]] {
        for (variable, value) in [("PSRGS_MAX_DEVICE_MEMORY", "6GX"), ("PSRGS_SUBGROUP", "7")] {
            let mut command = Command::new(env!("CARGO_BIN_EXE_psrgs-vk"));
            let output = command.args(args).env(variable, value).output().expect("the command starts");
            let said = stderr(&output);
            assert_eq!(output.status.code(), Some(2), "{args:?}: {said}");
            assert!(said.contains(&format!("{variable}={value}")), "{args:?}: {said}");
        }
    }
}

#[test]
fn without_a_driver_the_message_says_what_to_install() {
    let output = Command::new(env!("CARGO_BIN_EXE_psrgs-vk"))
        .arg("info")
        .envs([("VK_DRIVER_FILES", "/nowhere"), ("VK_ICD_FILENAMES", "/nowhere")])
        .output()
        .expect("the command starts");
    assert_eq!(output.status.code(), Some(4));
    assert!(stderr(&output).contains("mesa-vulkan-drivers"), "{}", stderr(&output));
}

#[test]
fn the_demo_writes_a_dataset_and_leaves_other_folders_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("demo");
    let name = out.to_str().expect("UTF-8");
    let output = psrgs(&["demo", "--out", name, "--images", "3", "--max-side", "48", "--no-train", "-q"]);
    assert!(output.status.success() && stderr(&output).is_empty(), "{}", stderr(&output));
    for file in
        ["world.toml", "images", "depth", "sparse/0/cameras.bin", "sparse/0/images.bin", "sparse/0/points3D.bin"]
    {
        assert!(out.join(file).exists(), "no {file}");
    }
    std::fs::remove_file(out.join("world.toml")).expect("removed");
    fails(&["demo", "--out", name, "--no-train"], 2, &["choose another folder"]);
    fails(&["demo", "--out", name, "--images", "0"], 2, &[]);
    let file = write(folder.path(), "file", "");
    fails(&["demo", "--out", &format!("{file}/x"), "--images", "1", "--no-train"], 8, &["cannot write"]);
}
