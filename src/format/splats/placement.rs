//! Where the splats of a file are: models moved to their middle or turned upright, and the way back in a file beside.

use std::path::{Path, PathBuf};

use serde_json::json;

use crate::format::ply::Model;
use crate::format::{Error, atomic, read_transform};
use crate::scene::{self, MapFrame, Similarity};

/// Ending of the name of the file beside a model.
const BESIDE: &str = ".frame.json";

/// The file beside a model, `NAME.frame.json`, that leads from dataset coordinates to those of the model: an object
/// with `transform`, a 4x4 matrix, and `scale`. Where the dataset's place on a map is known, `file_to_map` is the 4x4
/// matrix from the numbers in the model's file to the map, and `map` the way from the dataset, as in `frame.json`.
pub fn file_beside(model: &Path) -> PathBuf {
    let mut name = model.file_name().unwrap_or_default().to_owned();
    name.push(BESIDE);
    model.with_file_name(name)
}

/// A model in the coordinates of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Turned {
    /// The splats as they are written. Its shift is zero where the model is turned.
    pub model: Model,
    /// From dataset coordinates to those of the file.
    pub to_file: Similarity,
    /// From dataset coordinates to those of the model before it was moved.
    from_dataset: Similarity,
}

impl Turned {
    /// Moves a model so that the median of its means is the origin where `centred` is set, then turns the direction
    /// `up` of the model to -y, the up of viewers. `from_dataset` leads from dataset coordinates to those of the model,
    /// [`Model::shift`] added.
    pub fn new(model: &Model, from_dataset: &Similarity, centred: bool, up: Option<[f64; 3]>) -> Self {
        let centre = if centred { median(&model.gaussians.means) } else { [0.0; 3] };
        let rotation = up.map_or(Similarity::IDENTITY.rotation, |up| scene::turn(up, [0.0, -1.0, 0.0]));
        let turn = Similarity { rotation, ..Similarity::IDENTITY };
        // Moving is exact enough in f64; f32 holds the small numbers that remain.
        let moved = turn.after_shift(centre.map(|v| -v));
        let gaussians =
            if moved == Similarity::IDENTITY { model.gaussians.clone() } else { moved.gaussians(&model.gaussians) };
        let shift: [f64; 3] = std::array::from_fn(|k| model.shift[k] + centre[k]);
        let to_file = from_dataset.then(&turn.after_shift(shift.map(|v| -v)));
        let is_turned = turn.rotation != Similarity::IDENTITY.rotation;
        let model = Model { gaussians, shift: if is_turned { [0.0; 3] } else { shift }, ..without_splats(model) };
        Self { model, to_file, from_dataset: *from_dataset }
    }

    /// Writes the file beside a model, or removes an old one where dataset and file have the same coordinates or the
    /// model's file holds the shift (`holds_shift`), and no map is known. The result says whether there is one.
    pub fn write_beside(&self, file: &Path, holds_shift: bool, map: Option<&MapFrame>) -> Result<bool, Error> {
        let told = holds_shift && self.to_file.rotation == self.from_dataset.rotation;
        // Readers add the shift that the model's file holds, and then go by the matrix.
        let matrix = if told { self.from_dataset } else { self.to_file };
        put(file, text(&matrix, &self.to_file, map))
    }
}

/// Writes the file beside a page that shows a model, which no program reads again: only where a map is known is there
/// something to say, else an old file is removed. `to_page` leads from dataset coordinates to those of the model within
/// the page. The result says whether there is a file.
pub fn write_beside_page(page: &Path, to_page: &Similarity, map: Option<&MapFrame>) -> Result<bool, Error> {
    put(page, map.and_then(|map| text(to_page, to_page, Some(map))))
}

/// Writes the file beside a model, or removes an old one.
fn put(model: &Path, text: Option<serde_json::Value>) -> Result<bool, Error> {
    let beside = file_beside(model);
    let Some(text) = text else {
        return atomic::remove(&beside).map(|()| false);
    };
    atomic::write(&beside, |out| writeln!(out, "{text:#}"))?;
    Ok(true)
}

/// The content of the file beside a model; `None` where there is nothing to say.
fn text(matrix: &Similarity, to_file: &Similarity, map: Option<&MapFrame>) -> Option<serde_json::Value> {
    // Readers take the scale of what the matrix gives, its translation too.
    let unscaled =
        Similarity { scale: 1.0, translation: matrix.translation.map(|v| v / matrix.scale), ..*matrix }.rows();
    let transform = json!({"transform": unscaled, "scale": matrix.scale});
    let Some(map) = map else { return (*matrix != Similarity::IDENTITY).then_some(transform) };
    let [a, b, c, _] = map.dataset_to_map;
    let mut text = transform;
    // A record that is no similarity was changed by hand.
    if let Ok(to_map) = Similarity::from_rows(&[a, b, c]) {
        text["file_to_map"] = json!(to_file.inverse().then(&to_map).rows());
        text["map"] = json!(map);
    }
    Some(text)
}

/// The model in dataset coordinates less its shift, by the file beside it, if there is one.
pub(super) fn placed(model: Model, file: &Path) -> Result<(Model, Option<PathBuf>), Error> {
    let beside = file_beside(file);
    if !beside.is_file() {
        return Ok((model, None));
    }
    let to_dataset = read_transform(&beside)?.inverse();
    // The translation is kept apart in f64.
    let shift = to_dataset.point(model.shift);
    let gaussians = Similarity { translation: [0.0; 3], ..to_dataset }.gaussians(&model.gaussians);
    Ok((Model { gaussians, shift, ..model }, Some(beside)))
}

fn without_splats(model: &Model) -> Model {
    Model {
        sh_degree: model.sh_degree,
        shift: model.shift,
        antialias: model.antialias,
        constrained: model.constrained,
        version: model.version.clone(),
        ..Model::default()
    }
}

/// The median of each coordinate.
fn median(means: &[f32]) -> [f64; 3] {
    [0, 1, 2].map(|k| {
        let mut values: Vec<f32> = means.iter().skip(k).step_by(3).copied().collect();
        if values.is_empty() {
            return 0.0;
        }
        let middle = values.len() / 2;
        f64::from(*values.select_nth_unstable_by(middle, f32::total_cmp).1)
    })
}
