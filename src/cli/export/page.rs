//! The HTML file that shows a model in a browser.

use super::options::Kind;
use super::{Args, Failure};
use crate::cli::console::Console;

/// Whether the options ask for an HTML file.
pub(super) fn wanted(args: &Args) -> bool {
    let ending = args.out.extension().is_some_and(|ending| {
        let ending = ending.to_string_lossy().to_lowercase();
        ending == "html" || ending == "htm"
    });
    args.format.map_or(ending, |kind| kind == Kind::Html)
}

/// Writes the file.
#[cfg(not(feature = "html-viewer"))]
pub(super) fn run(args: &Args, _: &Console) -> anyhow::Result<()> {
    let text = format!(
        "--out {}: {}: build the program with this feature, or write a .sog file for another viewer",
        args.out.display(),
        crate::cli::model_page::NO_VIEWER
    );
    Err(Failure::Usage(text).into())
}

#[cfg(feature = "html-viewer")]
pub(super) use with_viewer::run;

#[cfg(feature = "html-viewer")]
mod with_viewer {
    use std::time::Instant;

    use psrgs_vk::dataset::{Dataset, LoadOptions};
    use psrgs_vk::format::atomic;
    use psrgs_vk::format::html::Shown;
    use psrgs_vk::format::splats::placement::{self, Turned};
    use psrgs_vk::numbers::{counted, fraction, grouped};
    use psrgs_vk::scene::Similarity;

    use super::super::{chosen, not_the_model, tell_beside, up};
    use super::{Args, Console, Failure};
    use crate::cli::model_file::ModelFile;
    use crate::cli::model_frame::ModelFrame;
    use crate::cli::{map_frame, model_page, output_guard};

    pub(in super::super) fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
        if args.json.is_some() {
            let text = "--json tells what formats cost, an HTML file is none of them: leave --json out";
            return Err(Failure::Usage(text.to_owned()).into());
        }
        not_the_model(args, &args.out)?;
        let model = ModelFile::read(&args.model, false, &args.scene.frame, args.files.strict, console)?;
        let dataset = args.cameras.as_deref().map(|folder| {
            let (max_side, strict) = (Some(args.max_side), args.files.strict);
            let options = LoadOptions { max_side, strict, photographs: false, ..LoadOptions::default() };
            Dataset::load(folder, &options)
        });
        let dataset = dataset.transpose()?;
        if let (Some(dataset), Some(folder)) = (&dataset, args.out.parent()) {
            dataset.warnings.iter().filter(|warning| warning.is_of_files()).for_each(|warning| console.warn(warning));
            output_guard::check(folder, dataset)?;
        }
        let up = up(args, &model, dataset.as_ref())?.map(|up| in_scene(up, &model, dataset.as_ref()));
        let kept = chosen(args, &model, console)?;
        atomic::check(&args.out)?;
        let before = Instant::now();
        let sh_degree = args.sh_degree.unwrap_or(3).min(kept.sh_degree);
        let map = map_frame::of_model(&args.model, &args.scene.frame, console);
        let (gaussians, cameras, to_shown) = match &dataset {
            Some(dataset) => {
                let gaussians = model.with_model(kept).in_scene(&dataset.frame);
                (gaussians, model_page::cameras(dataset), Similarity::to_scene(&dataset.frame))
            }
            // Small numbers about the origin, where f32 is exact.
            None => {
                let moved = Turned::new(&kept, &model.dataset_to_model(), true, None);
                (moved.model.gaussians, Vec::new(), moved.to_file)
            }
        };
        let shown = Shown {
            title: &args.out.file_stem().unwrap_or_default().to_string_lossy(),
            gaussians: &gaussians,
            cameras: &cameras,
            up,
            sh_degree,
            background: args.scene.background.rgb,
            antialias: model.antialias,
        };
        let page = shown.html()?;
        atomic::write(&args.out, |out| out.write_all(page.as_bytes()))?;
        console.say(format_args!(
            "{}: {} in {} bytes, spherical harmonics of degree {sh_degree}, written in {} s; a browser opens the file \
             without a network",
            args.out.display(),
            counted(gaussians.len(), "splat"),
            grouped(page.len() as u64),
            fraction(before.elapsed().as_secs_f64(), 1),
        ));
        if placement::write_beside_page(&args.out, &to_shown.then(&shown.to_file()), map.as_ref())? {
            tell_beside(&args.out, map.as_ref(), console);
        }
        if dataset.is_none() {
            console.say(format_args!("with --cameras DATA the page begins at a photograph's camera, and up is known"));
        }
        Ok(())
    }

    /// A direction of the model in the scene.
    fn in_scene(up: [f64; 3], model: &ModelFile, dataset: Option<&Dataset>) -> [f64; 3] {
        match &model.frame {
            ModelFrame::Other { to_dataset, .. } if dataset.is_some() => {
                to_dataset.rotation.map(|row| (0..3).map(|k| row[k] * up[k]).sum())
            }
            _ => up,
        }
    }
}
