//! The folder of a plan.

use std::path::{Path, PathBuf};

use super::done::{BEGUN_FILE, DONE_FILE, DoneFile, GLOBAL, Origin, Stale};
use super::{Block, PLAN_FILE, PlanFile, sha256_of};
use crate::format::Error;
use crate::format::ply::Splats;
use crate::scene::Region;

/// Name of models.
pub const MODEL_FILE: &str = "point_cloud.ply";

/// A plan in its folder.
#[derive(Clone, Debug)]
pub struct PlanFolder {
    /// The folder.
    pub path: PathBuf,
    /// The plan.
    pub plan: PlanFile,
    /// SHA-256 of the plan.
    pub sha256: String,
}

/// How far the training of a block is.
#[derive(Debug)]
pub enum BlockState {
    /// Nothing is there.
    Waiting,
    /// Training has begun.
    Begun,
    /// The model is there.
    Done(Box<DoneFile>),
    /// What is there may not be used.
    Stale(Stale),
    /// What is there cannot be read.
    Damaged(Error),
}

impl PlanFolder {
    /// Reads the plan in a folder.
    pub fn open(path: &Path) -> Result<Self, Error> {
        let file = path.join(PLAN_FILE);
        let plan = PlanFile::read(&file)?;
        Ok(Self { path: path.to_owned(), plan, sha256: sha256_of(&file)?.0 })
    }

    /// The folder of a block, or of the coarse model.
    pub fn folder_of(&self, block: &str) -> PathBuf {
        match block {
            GLOBAL => self.path.join(GLOBAL),
            block => self.path.join("blocks").join(block),
        }
    }

    /// The model of a block, or the coarse model.
    pub fn model_of(&self, block: &str) -> PathBuf {
        self.folder_of(block).join(MODEL_FILE)
    }

    /// What a training of a block is for.
    pub fn origin(&self, block: &str, global_sha256: Option<&str>) -> Origin {
        Origin::new(&self.sha256, block, global_sha256)
    }

    /// How far a block is, with the whole content of its model compared.
    pub fn state(&self, block: &str) -> BlockState {
        self.state_by(block, |done, wanted, model| done.stale(wanted, model))
    }

    /// As [`Self::state`], but of a model only its length is compared, which takes no time.
    pub fn quick_state(&self, block: &str) -> BlockState {
        self.state_by(block, |done, wanted, model| {
            if let Some(stale) = done.origin.stale(wanted) {
                return Ok(Some(stale));
            }
            if !model.is_file() {
                return Ok(Some(Stale::NoModel));
            }
            let whole = Splats::open(model).is_ok_and(|splats| splats.count == done.splats);
            Ok((!whole).then_some(Stale::OtherModel))
        })
    }

    fn state_by(
        &self,
        block: &str,
        stale: impl Fn(&DoneFile, &Origin, &Path) -> Result<Option<Stale>, Error>,
    ) -> BlockState {
        let (folder, wanted) = (self.folder_of(block), self.origin(block, None));
        let there = |name: &str| Some(folder.join(name)).filter(|file| file.symlink_metadata().is_ok());
        let found = match (there(DONE_FILE), there(BEGUN_FILE)) {
            (Some(done), _) => DoneFile::read(&done).and_then(|done| {
                let stale = stale(&done, &wanted, &self.model_of(block))?;
                Ok(stale.map_or_else(|| BlockState::Done(Box::new(done)), BlockState::Stale))
            }),
            (None, Some(begun)) => {
                Origin::read(&begun).map(|begun| begun.stale(&wanted).map_or(BlockState::Begun, BlockState::Stale))
            }
            (None, None) => Ok(BlockState::Waiting),
        };
        found.unwrap_or_else(BlockState::Damaged)
    }

    /// The cell of a block, in dataset coordinates.
    pub fn region(&self, block: &Block) -> Region {
        let ground = &self.plan.ground;
        let edges = [block.cell.x, block.cell.y];
        Region {
            origin: ground.origin,
            axes: [ground.east, ground.north],
            low: edges.map(|[low, _]| low.unwrap_or(f64::NEG_INFINITY)),
            high: edges.map(|[_, high]| high.unwrap_or(f64::INFINITY)),
        }
    }
}
