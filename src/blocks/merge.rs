//! One model from the models of the blocks. Each cell keeps the splats whose means lie in it, so every place has the
//! splats of one block.

use std::path::{Path, PathBuf};

use super::PlanFile;
use crate::format::ply::{self, SplatBytes, Splats};
use crate::format::{At, Error};

/// The model of a block.
#[derive(Clone, Debug)]
pub struct BlockModel {
    /// Position of the block in the plan.
    pub block: usize,
    /// Its model.
    pub file: PathBuf,
}

/// What merging has done.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Merged {
    /// Splats of the merged model.
    pub splats: u64,
    /// Splats of each block, in the order of the plan: kept, and left out because another block owns their place.
    pub of_blocks: Vec<[u64; 2]>,
}

/// Writes one model to `out`: of each block the splats that lie in its cell, in the order of the plan. Splats are read
/// one by one, twice, so the memory does not depend on their number. The file is written whole or not at all.
pub fn merge(plan: &PlanFile, models: &[BlockModel], out: &Path) -> Result<Merged, Error> {
    let mut models = models.to_vec();
    models.sort_by_key(|model| model.block);
    // A block that is named twice counts once.
    models.dedup_by_key(|model| model.block);
    let mut merged = Merged { splats: 0, of_blocks: vec![[0; 2]; plan.blocks.len()] };
    let mut common = None;
    for model in &models {
        let mut splats = Splats::open(&model.file)?;
        common = agreed(common, &splats, &model.file)?;
        let Some(counts) = merged.of_blocks.get_mut(model.block) else { continue };
        while let Some(splat) = splats.next_splat()? {
            counts[usize::from(!owns(plan, model.block, &splat, splats.shift))] += 1;
        }
        merged.splats += counts[0];
    }
    let (shift, antialias) = common.unwrap_or_default();
    ply::write_splats(out, merged.splats, (shift, antialias), |write| {
        for model in &models {
            let mut splats = Splats::open(&model.file)?;
            let from = splats.shift;
            while let Some(mut splat) = splats.next_splat()? {
                if owns(plan, model.block, &splat, from) {
                    moved(&mut splat, from, shift);
                    write(&splat).map_err(Error::io(out, "write"))?;
                }
            }
        }
        Ok(())
    })?;
    Ok(merged)
}

/// What a merged file says of its splats: the shift of their coordinates, and whether they are anti-aliased.
type Common = ([f64; 3], Option<bool>);

/// The shift of the first model, and what all models say of anti-aliasing.
fn agreed(common: Option<Common>, splats: &Splats, file: &Path) -> Result<Option<Common>, Error> {
    let own = (splats.shift, splats.antialias);
    match common {
        Some((_, antialias)) if antialias != own.1 => {
            let problem = "other blocks were trained with another `antialias`: train all blocks for one plan";
            Err(Error::malformed(file, "comment SplatRenderMode", At::Byte(0), problem))
        }
        Some(common) => Ok(Some(common)),
        None => Ok(Some(own)),
    }
}

fn owns(plan: &PlanFile, block: usize, splat: &SplatBytes, shift: [f64; 3]) -> bool {
    let place = ply::position(splat);
    let point = std::array::from_fn(|k| f64::from(place[k]) + shift[k]);
    plan.blocks.get(block).is_some_and(|block| block.cell.contains(plan.ground.place(point)))
}

/// Moves a splat from coordinates with one shift to those with another; the bits stay where the shifts are equal.
fn moved(splat: &mut SplatBytes, from: [f64; 3], to: [f64; 3]) {
    if from != to {
        let place = ply::position(splat);
        ply::set_position(splat, std::array::from_fn(|k| (f64::from(place[k]) + (from[k] - to[k])) as f32));
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::fs;

    use super::*;
    use crate::blocks::{Block, Cell, DatasetRecord, FORMAT, GlobalModel, Ground, VERSION};
    use crate::format::ply::Model;
    use crate::scene::Gaussians;
    use crate::scene::random::Random;

    /// A plan of four cells around the origin of a turned ground.
    fn plan() -> PlanFile {
        let block = |id: &str, x, y| Block {
            id: id.to_owned(),
            cell: Cell { x, y },
            margin: 1.0,
            photographs: Vec::new(),
            steps: 1,
            predicted_splats: 0,
            predicted_memory: 0,
            predicted_seconds: None,
        };
        let (low, high) = ([None, Some(0.1)], [Some(0.1), None]);
        PlanFile {
            format: FORMAT.to_owned(),
            version: VERSION,
            program: String::new(),
            dataset: DatasetRecord {
                path: PathBuf::new(),
                model_sha256: String::new(),
                photographs: 0,
                files: Vec::new(),
            },
            settings: String::new(),
            seed: 0,
            ground: Ground {
                origin: [1000.5, -20.25, 3.0],
                east: [0.6, 0.8, 0.0],
                north: [-0.8, 0.6, 0.0],
                up: [0.0, 0.0, 1.0],
            },
            global: GlobalModel { photographs: Vec::new(), max_side: 1, steps: 1, max_splats: 1 },
            blocks: vec![
                block("b00", low, low),
                block("b01", high, low),
                block("b02", low, high),
                block("b03", high, high),
            ],
        }
    }

    /// Points at ground coordinates, some of them on the edges of cells.
    fn points(random: &mut Random, ground: &Ground, n: usize) -> Vec<[f64; 3]> {
        let mut along = || match random.bits() % 4 {
            0 => 0.1,
            1 => f64::from(0.1_f32),
            _ => 4.0 * random.unit() - 2.0,
        };
        (0..n).map(|_| ground.dataset_point([along(), along(), along()])).collect()
    }

    /// A model whose splats have their numbers from `first` on as opacities.
    fn model(points: &[[f64; 3]], shift: [f64; 3], first: usize) -> Model {
        let mut gaussians = Gaussians::zeros(points.len());
        for (k, point) in points.iter().enumerate() {
            for axis in 0..3 {
                gaussians.means[3 * k + axis] = (point[axis] - shift[axis]) as f32;
            }
            gaussians.opacities[k] = (first + k) as f32;
        }
        Model { gaussians, sh_degree: 3, shift, antialias: Some(false), ..Model::default() }
    }

    /// All blocks have the same splats: each is in the merged model once, whatever the order of the blocks.
    #[test]
    fn of_equal_blocks_each_splat_is_kept_once() {
        let folder = tempfile::tempdir().unwrap();
        let (plan, out) = (plan(), folder.path().join("merged.ply"));
        for seed in 0..8 {
            let mut random = Random::new(seed);
            let points = points(&mut random, &plan.ground, 500);
            let file = folder.path().join("model.ply");
            ply::write(&file, &model(&points, [1000.0, 0.0, 0.0], 0)).unwrap();
            let mut models: Vec<BlockModel> = (0..4).map(|block| BlockModel { block, file: file.clone() }).collect();
            let first = merge(&plan, &models, &out).unwrap();
            let bytes = fs::read(&out).unwrap();
            assert_eq!((first.splats, first.of_blocks.len()), (500, 4));
            let merged = ply::read(&out).unwrap();
            let mut numbers: Vec<u32> = merged.gaussians.opacities.iter().map(|o| *o as u32).collect();
            numbers.sort_unstable();
            assert_eq!(numbers, (0..500).collect::<Vec<_>>(), "seed {seed}");
            // Shuffled, and with a block twice.
            models.rotate_left(1 + (seed as usize) % 3);
            models.push(models[(seed as usize) % 4].clone());
            assert_eq!(merge(&plan, &models, &out).unwrap(), first);
            assert_eq!(fs::read(&out).unwrap(), bytes, "seed {seed}");
        }
    }

    /// Blocks with splats of their own: the merged model has those of each that lie in its cell, and no others.
    #[test]
    fn of_different_blocks_each_cell_has_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let (plan, out) = (plan(), folder.path().join("merged.ply"));
        let mut random = Random::new(9);
        let shifts = [[1000.0, 0.0, 0.0], [1000.0, 0.0, 0.0], [0.0; 3], [990.0, 5.0, 1.0]];
        let (mut models, mut expected) = (Vec::new(), BTreeMap::new());
        for (block, shift) in shifts.into_iter().enumerate() {
            let of_block = model(&points(&mut random, &plan.ground, 300), shift, 300 * block);
            let file = folder.path().join(format!("{block}.ply"));
            ply::write(&file, &of_block).unwrap();
            for (mean, opacity) in of_block.gaussians.means.chunks_exact(3).zip(&of_block.gaussians.opacities) {
                let point = std::array::from_fn(|k| f64::from(mean[k]) + shift[k]);
                if plan.owner(point) == Some(block) {
                    expected.insert(*opacity as u32, point);
                }
            }
            models.push(BlockModel { block, file });
        }
        let merged = merge(&plan, &models, &out).unwrap();
        assert_eq!(merged.splats, expected.len() as u64);
        assert!(merged.of_blocks.iter().all(|[kept, left_out]| *kept > 0 && kept + left_out == 300));
        let read = ply::read(&out).unwrap();
        for (mean, opacity) in read.gaussians.means.chunks_exact(3).zip(&read.gaussians.opacities) {
            let point = expected.remove(&(*opacity as u32)).expect("a splat of the cell, once");
            for k in 0..3 {
                assert!((f64::from(mean[k]) + read.shift[k] - point[k]).abs() < 1e-4);
            }
        }
        assert!(expected.is_empty(), "lost: {expected:?}");
    }

    #[test]
    fn a_truncated_block_leaves_the_earlier_model_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let [file, out] = ["model.ply", "merged.ply"].map(|name| folder.path().join(name));
        fs::write(&out, "earlier").unwrap();
        ply::write(&file, &model(&[[1000.0, -20.0, 3.0]; 9], [0.0; 3], 0)).unwrap();
        let whole = fs::read(&file).unwrap();
        fs::write(&file, &whole[..whole.len() - 5]).unwrap();
        let problem = merge(&plan(), &[BlockModel { block: 2, file }], &out).unwrap_err().to_string();
        assert!(problem.contains("model.ply") && problem.contains("9 splats"), "{problem}");
        assert_eq!(fs::read_to_string(&out).unwrap(), "earlier");
    }
}
