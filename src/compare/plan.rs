//! The runs of a comparison.

use std::path::PathBuf;

use crate::format::names;

/// How many splats a run may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Size {
    /// As many as the method makes.
    Own,
    /// At most this share of what `3dgs` made of the scene with the same seed, in percent.
    Percent(u32),
}

/// A training of a comparison.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Run {
    /// Name of the scene.
    pub scene: String,
    /// Its dataset.
    pub data: PathBuf,
    /// What the row is called: a method, a method with settings of its own, or a method without one of its parts.
    pub label: String,
    /// The label without a note on what was found.
    pub row: String,
    /// The method.
    pub method: String,
    /// Options beyond those of all runs.
    pub options: Vec<String>,
    /// Seed.
    pub seed: u64,
    /// Splats.
    pub size: Size,
}

impl Run {
    /// The folder of the run among those of the comparison.
    pub fn folder(&self) -> String {
        let size = match self.size {
            Size::Own => String::new(),
            Size::Percent(share) => format!("-{share}percent"),
        };
        let ending = format!("-{}{size}-s{}", in_a_file_name(&self.row), self.seed);
        format!("{}{ending}", names::bounded(&self.scene, 255_usize.saturating_sub(ending.len())))
    }
}

/// Most bytes of a row in the name of a folder.
const LONGEST_ROW: usize = 160;

/// A row as a part of a file name on every file system: `3dgs:start=stereo` is `3dgs+start~stereo`. Other rows have
/// other names, also where case is ignored.
fn in_a_file_name(row: &str) -> String {
    let mut out = String::new();
    for byte in row.bytes() {
        match byte {
            b':' => out.push('+'),
            b'=' => out.push('~'),
            b'a'..=b'z' | b'0'..=b'9' | b'.' | b'-' => out.push(char::from(byte)),
            byte => out += &format!("%{byte:02x}"),
        }
    }
    names::bounded(&out, LONGEST_ROW)
}

/// The metric by which a part of a method is judged, and its direction: named before any run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Primary {
    /// PSNR of what is seen, higher with the part.
    PsnrSeenUp,
    /// The median error of depths, lower with the part.
    DepthErrorDown,
    /// The number of splats, lower with the part.
    SplatsDown,
    /// LPIPS, lower with the part.
    LpipsDown,
}

/// A method without one of its parts, or with another form of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ablation {
    /// What the row is called, after the method.
    pub name: &'static str,
    /// The options that make it.
    pub options: &'static [&'static str],
    /// What the part that is left out or replaced is judged by.
    pub primary: Primary,
}

/// An option of an ablation: low-grad-threshold as the method's own grad-threshold.
pub const OWN_GRAD_THRESHOLD: &str = "--set=low-grad-threshold={grad-threshold}";

/// What is left out or replaced, one at a time. What a method has so already is no row of it.
pub const ABLATIONS: [Ablation; 38] = [
    Ablation { name: "no-stereo", options: &["--start=sfm", "--depth-prior=none"], primary: Primary::DepthErrorDown },
    Ablation {
        name: "no-depth-loss",
        options: &["--lambda-depth", "0", "--lambda-normal", "0"],
        primary: Primary::DepthErrorDown,
    },
    Ablation { name: "no-smoothness", options: &["--set=lambda-smooth=0"], primary: Primary::DepthErrorDown },
    Ablation { name: "free-harmonics", options: &["--set=lambda-sh=0"], primary: Primary::PsnrSeenUp },
    Ablation { name: "no-flattening", options: &["--set=lambda-flatten=0"], primary: Primary::DepthErrorDown },
    Ablation { name: "start-sfm", options: &["--start=sfm"], primary: Primary::LpipsDown },
    Ablation { name: "uniform-spacing", options: &["--set=stereo-spacing=uniform"], primary: Primary::PsnrSeenUp },
    Ablation { name: "round-stereo-splats", options: &["--set=stereo-thickness=1"], primary: Primary::PsnrSeenUp },
    Ablation { name: "wide-stereo-splats", options: &["--set=stereo-width=1"], primary: Primary::PsnrSeenUp },
    Ablation { name: "faint-stereo-splats", options: &["--set=stereo-opacity=0.1"], primary: Primary::PsnrSeenUp },
    Ablation { name: "texture-left-out", options: &["--set=stereo-texture=0.5"], primary: Primary::PsnrSeenUp },
    Ablation { name: "no-lone-splats", options: &["--set=stereo-alone=0"], primary: Primary::PsnrSeenUp },
    Ablation { name: "no-exposures", options: &["--exposure", "off"], primary: Primary::PsnrSeenUp },
    Ablation { name: "no-mask-growth", options: &["--set=sample-mask-share=0"], primary: Primary::PsnrSeenUp },
    Ablation { name: "no-error-growth", options: &["--set=sample-error-share=0"], primary: Primary::PsnrSeenUp },
    Ablation { name: "one-threshold", options: &[OWN_GRAD_THRESHOLD], primary: Primary::PsnrSeenUp },
    // The order of the paper's abstract, which its second figure contradicts.
    Ablation {
        name: "low-threshold-first",
        options: &["--set=low-grad-threshold=1.5e-4"],
        primary: Primary::PsnrSeenUp,
    },
    Ablation { name: "along-gradient", options: &["--set=split-along-gradient=true"], primary: Primary::PsnrSeenUp },
    Ablation { name: "no-low-weights", options: &["--set=low-texture-weight=1"], primary: Primary::PsnrSeenUp },
    // The constrained set is what the stage leaves.
    Ablation {
        name: "no-low-stage",
        options: &["--set=low-stage=0", "--set=lambda-constrained=0", "--set=sigma-learning=off"],
        primary: Primary::DepthErrorDown,
    },
    Ablation {
        name: "geometry-in-stage-alone",
        options: &["--set=depth-steps=0.25"],
        primary: Primary::DepthErrorDown,
    },
    Ablation { name: "opacities-undecided", options: &["--set=lambda-binary=0"], primary: Primary::SplatsDown },
    Ablation { name: "fixed-sigma", options: &["--set=sigma-learning=off"], primary: Primary::PsnrSeenUp },
    Ablation { name: "composite-sigma", options: &["--set=sigma-learning=composite"], primary: Primary::PsnrSeenUp },
    Ablation {
        name: "gate-gradient",
        options: &["--gate", "gradient", "--set=sigma-learning=off"],
        primary: Primary::PsnrSeenUp,
    },
    Ablation {
        name: "gate-phase",
        options: &["--gate", "phase", "--set=sigma-learning=off"],
        primary: Primary::PsnrSeenUp,
    },
    Ablation {
        name: "gate-random",
        options: &["--gate", "random", "--set=sigma-learning=off"],
        primary: Primary::PsnrSeenUp,
    },
    Ablation {
        name: "gate-off",
        options: &["--gate", "off", "--set=sigma-learning=off"],
        primary: Primary::PsnrSeenUp,
    },
    Ablation {
        name: "no-gradient-maps",
        options: &["--set=lambda-gradients=0", "--set=lambda-variation=0", "--set=lambda-constrained=0"],
        primary: Primary::LpipsDown,
    },
    Ablation { name: "no-constrained-maps", options: &["--set=lambda-constrained=0"], primary: Primary::LpipsDown },
    Ablation { name: "no-perceptual", options: &["--lambda-perceptual", "0"], primary: Primary::LpipsDown },
    Ablation { name: "one-perceptual-view", options: &["--set=perceptual-views=1"], primary: Primary::LpipsDown },
    Ablation { name: "coarse-steps", options: &["--set=coarse-steps=0.2"], primary: Primary::PsnrSeenUp },
    Ablation { name: "no-coarse-steps", options: &["--set=coarse-steps=0"], primary: Primary::PsnrSeenUp },
    Ablation { name: "no-pruning", options: &["--prune-weight", "0"], primary: Primary::SplatsDown },
    Ablation { name: "steps-of-all", options: &["--set=visible-adam=false"], primary: Primary::PsnrSeenUp },
    Ablation { name: "published-dssim", options: &["--lambda-dssim", "0.2"], primary: Primary::PsnrSeenUp },
    Ablation { name: "no-early-cutoff", options: &["--set=early-steps=0"], primary: Primary::PsnrSeenUp },
];

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(row: &str, size: Size) -> String {
        let run = Run {
            scene: "fox".into(),
            data: "fox".into(),
            label: format!("{row} (a note)"),
            row: row.into(),
            method: "3dgs".into(),
            options: Vec::new(),
            seed: 2,
            size,
        };
        run.folder()
    }

    #[test]
    fn rows_have_folders_of_their_own_on_every_file_system() {
        assert_eq!(folder("psrgs-no-stereo", Size::Percent(50)), "fox-psrgs-no-stereo-50percent-s2");
        assert_eq!(folder("3dgs:start=stereo:low-stage=0", Size::Own), "fox-3dgs+start~stereo+low-stage~0-s2");
        let long = |end: &str| format!("3dgs:init={}{end}", "x".repeat(500));
        let rows =
            ["3dgs:init=a/b.ply", "3dgs:init=A/b.ply", "3dgs:init=a\\b.ply", "3dgs:init=a+b.ply", "3dgs:init=a b.ply"];
        let rows = rows.map(str::to_owned).into_iter().chain([long("a"), long("b")]);
        let mut seen = std::collections::BTreeSet::new();
        for row in rows {
            let name = folder(&row, Size::Own);
            assert!(name.len() < 255 && !name.contains(|c| "<>:\"/\\|?*= ".contains(c)), "{name}");
            assert!(seen.insert(name.to_lowercase()), "{name} is the folder of two rows");
        }
    }
}
