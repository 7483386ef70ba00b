//! Files in the formats of viewers, compared with independent programs: splat-transform and the glTF validator on Node,
//! gsply, laspy and pyproj on Python. `tools/readers` installs them into `target/readers`; `PSRGS_READERS` names another folder.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use psrgs_vk::format::ply::{self, Model};
use psrgs_vk::format::splats::spz::Version;
use psrgs_vk::format::splats::{self, Format};
use psrgs_vk::scene::Gaussians;

use super::common::skipped;
use super::compact::{ALL, angle, colours, farthest, opacity, rest, with_degree};

/// A program in the folder of readers; `None` where the program or what runs it is missing.
pub(crate) fn installed(path: &str, runs: &str) -> Option<PathBuf> {
    let usual = || Path::new(env!("CARGO_MANIFEST_DIR")).join("target/readers");
    let folder = std::env::var_os("PSRGS_READERS").map_or_else(usual, PathBuf::from);
    let file = folder.join(path);
    let known = file.exists() && Command::new(runs).arg("--version").output().is_ok_and(|o| o.status.success());
    if !known {
        skipped(format_args!("{} is not there (tools/readers installs it)", file.display()));
    }
    known.then_some(file)
}

/// Runs a program to its end.
#[track_caller]
pub(crate) fn run(command: &mut Command) -> String {
    let output = command.output().expect("a program");
    let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{command:?}: {said}");
    said
}

fn to_ply(program: &Path, from: &Path, to: &Path) {
    run(Command::new("node").arg(program).args(["-q", "-w"]).args([from, to]));
}

pub(crate) const SPLAT_TRANSFORM: &str = "node_modules/@playcanvas/splat-transform/bin/cli.mjs";

/// The formats that splat-transform reads, with the versions of SPZ.
fn written(folder: &Path, model: &Model) -> Vec<PathBuf> {
    let known = ALL.into_iter().filter(|format| *format != Format::Glb);
    let versions = [Format::Spz(Version::Two), Format::Spz(Version::Three)];
    let files = known.chain(versions).enumerate();
    let written = files.map(|(at, format)| {
        let file = folder.join(format!("{at}.{}", format.extension()));
        format.write(&file, model, 3).expect("written");
        file
    });
    written.collect()
}

/// Whether two models have the same values, but for roundings of f32; rotations of `.splat` files may differ by half a
/// step of a byte.
#[track_caller]
fn same(ours: &Model, theirs: &Model, file: &Path) {
    let near = |a: f64, b: f64| (a - b).abs();
    let (a, b) = (&ours.gaussians, &theirs.gaussians);
    let name = file.display();
    assert_eq!(a.len(), b.len(), "{name}");
    assert!(farthest(&a.means, &b.means, |a, b| near(a, b) / a.abs().max(1.0)) < 1e-6, "{name}");
    assert!(farthest(&a.scales, &b.scales, near) < 1e-5, "{name}");
    assert!(farthest(&a.opacities, &b.opacities, |a, b| near(opacity(a), opacity(b))) < 1e-5, "{name}");
    assert!(farthest(&colours(a), &colours(b), near) < 1e-5, "{name}");
    assert!(farthest(&rest(a, 3), &rest(b, 3), near) < 1e-5, "{name}");
    let turn = if Format::of_name(file) == Some(Format::Splat) { 0.02 } else { 2e-3 };
    assert!(angle(a, b) < turn, "{name}: {}", angle(a, b));
}

#[test]
fn splat_transform_reads_the_files_as_this_program() {
    let Some(program) = installed(SPLAT_TRANSFORM, "node") else { return };
    let folder = tempfile::tempdir().expect("temporary folder");
    for degree in [0, 3] {
        for file in written(folder.path(), &with_degree(300, degree)) {
            let back = file.with_extension("back.ply");
            to_ply(&program, &file, &back);
            same(&splats::read(&file, true).expect("read"), &ply::read(&back).expect("read"), &file);
        }
    }
}

#[test]
fn files_of_splat_transform_are_read_as_by_itself() {
    let Some(program) = installed(SPLAT_TRANSFORM, "node") else { return };
    let folder = tempfile::tempdir().expect("temporary folder");
    let original = folder.path().join("original.ply");
    // So few splats that its k-means on a processor ends soon.
    Format::Ply.write(&original, &with_degree(300, 3), 3).expect("written");
    for (name, options) in [
        ("a.compressed.ply", &[][..]),
        ("three.spz", &["--spz-version", "3"]),
        ("four.spz", &[]),
        ("a.sog", &["-g", "cpu", "--max-workers", "0"]),
        ("rest.sog", &["-g", "cpu", "-i", "1", "--max-workers", "0"]),
        ("a.glb", &[]),
    ] {
        let file = folder.path().join(name);
        let without_harmonics: &[&str] = if name == "a.sog" { &["-H", "0"] } else { &[] };
        let mut command = Command::new("node");
        command.arg(&program).args(["-q", "-w"]).args(options).arg(&original).args(without_harmonics).arg(&file);
        run(&mut command);
        let ours = splats::read(&file, true).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((ours.gaussians.len(), ours.sh_degree), (300, if name == "a.sog" { 0 } else { 3 }), "{name}");
        if name == "a.glb" {
            continue;
        }
        let back = file.with_extension("back.ply");
        to_ply(&program, &file, &back);
        same(&ours, &ply::read(&back).expect("read"), &file);
    }
}

const GSPLY: &str = "\
import sys, numpy, gsply
from gsply.spz import read_spz
from gsply.sog_reader import sogread
for name in sys.argv[1:]:
    read = read_spz if name.endswith('spz') else sogread if name.endswith('sog') else gsply.plyread
    data = read(name)
    planes = [data.means, data.quats, data.scales, data.opacities, data.sh0]
    numpy.concatenate([numpy.asarray(p, '<f4').reshape(-1) for p in planes]).tofile(name + '.planes')
";

#[test]
fn gsply_reads_the_files_as_this_program() {
    let Some(python) = installed("venv/bin/python", "python3") else { return };
    let folder = tempfile::tempdir().expect("temporary folder");
    let known = |file: &PathBuf| !matches!(Format::of_name(file), Some(Format::Splat | Format::Ply));
    let files: Vec<PathBuf> = written(folder.path(), &with_degree(300, 3)).into_iter().filter(known).collect();
    run(Command::new(python).args(["-c", GSPLY]).args(&files));
    for file in &files {
        let planes = fs::read(file.with_added_extension("planes")).expect("planes");
        let floats: Vec<f32> = planes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        let part = |from: usize, to: usize| floats[300 * from..300 * to].to_vec();
        let mut theirs = Gaussians { means: part(0, 3), quats: part(3, 7), ..Gaussians::zeros(300) };
        (theirs.scales, theirs.opacities) = (part(7, 10), part(10, 11));
        if let Some(Format::Spz(_)) = Format::of_name(file) {
            // gsply leaves the axes as they are in the file: right, up, back.
            theirs.means.chunks_exact_mut(3).for_each(|p| p[1..].iter_mut().for_each(|v| *v = -*v));
            theirs.quats.chunks_exact_mut(4).for_each(|q| q[2..].iter_mut().for_each(|v| *v = -*v));
        }
        let ours = splats::read(file, true).expect("read").gaussians;
        let near = |a: f64, b: f64| (a - b).abs();
        let name = file.display();
        assert!(farthest(&ours.means, &theirs.means, near) < 1e-5, "{name}");
        assert!(farthest(&ours.scales, &theirs.scales, near) < 1e-5, "{name}");
        assert!(farthest(&ours.opacities, &theirs.opacities, |a, b| near(opacity(a), opacity(b))) < 1e-4, "{name}");
        assert!(farthest(&colours(&ours), &part(11, 14), near) < 1e-5, "{name}");
        theirs.normalise_quats();
        assert!(angle(&ours, &theirs) < 2e-3, "{name}: {}", angle(&ours, &theirs));
    }
}

pub(crate) const VALIDATE: &str = "\
const validator = require(process.argv[1]);
const fs = require('fs');
for (const file of process.argv.slice(2))
    validator.validateBytes(new Uint8Array(fs.readFileSync(file)), { maxIssues: 0 }).then((report) => {
        for (const issue of report.issues.messages) console.log(issue.code, issue.message, issue.pointer);
        console.log('DONE', file);
    });
";

#[test]
fn the_gltf_validator_reports_the_extension_alone() {
    let Some(validator) = installed("node_modules/gltf-validator", "node") else { return };
    let folder = tempfile::tempdir().expect("temporary folder");
    let files: Vec<PathBuf> = [(0, 0), (1, 0), (300, 1), (300, 3)]
        .map(|(n, degree)| {
            let file = folder.path().join(format!("{n}-{degree}.glb"));
            Format::Glb.write(&file, &with_degree(n, degree), 3).expect("written");
            file
        })
        .to_vec();
    let said = run(Command::new("node").args(["-e", VALIDATE]).arg(&validator).args(&files));
    assert_eq!(said.lines().filter(|line| line.starts_with("DONE")).count(), files.len(), "{said}");
    for line in said.lines().filter(|line| !line.starts_with("DONE")) {
        let known = line.starts_with("UNSUPPORTED_EXTENSION")
            || line.starts_with("MESH_PRIMITIVE_INVALID_ATTRIBUTE") && line.contains("KHR_gaussian_splatting:");
        assert!(known, "{line}");
    }
}
