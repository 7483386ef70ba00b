//! Plans the blocks of a scene.

use std::path::Path;

use super::error::{Error, Limit};
use super::frequency::Frequency;
use super::memory::Memory;
use super::partition::{Weighted, partition};
use super::photographs::{Chosen, Part, choose};
use super::plan_file::{Block, DatasetRecord, FORMAT, GlobalModel, PlanFile, PlannedPhotograph, VERSION, is_inside};
use super::surface::{Piece, Surface};
use super::time::seconds_per_step;
use super::{Cell, FileRecord, Ground, hash};
use crate::dataset::{Dataset, HostShare, Role, View};
use crate::train::Settings;
use crate::vk::Gpu;

/// Most blocks that are tried where a limit decides how many there are.
const MOST_BLOCKS: usize = 4096;
/// Where blocks are too large, so much of the larger number of blocks that would be right without margins is passed over.
const SURE: f64 = 0.7;
/// Rounds in which cells are made fit for blocks that take equally long, and the exponent of a step towards that.
const ROUNDS: usize = 4;
const STEP: f64 = 0.7;
/// Splats of the coarse model of everything, as a share of those of the whole, and the fewest of them.
const COARSE_SPLATS: (f64, u64) = (1.0 / 64.0, 256);
/// Photographs of the coarse model are this much smaller, but no smaller than so many pixels.
const COARSE_SIDE: (u32, u32) = (4, 96);
/// Steps of the coarse model, as a share of those of the whole.
const COARSE_STEPS: f64 = 0.5;

/// How many blocks there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Count {
    /// So many, or fewer where points lie in fewer places.
    Blocks(usize),
    /// The fewest of which none takes more.
    Within(Limit),
}

/// What a plan is made from.
pub struct PlanRequest<'a> {
    /// The dataset, loaded with its photographs.
    pub dataset: &'a Dataset,
    /// Settings of the training of the whole, with its number of steps.
    pub settings: &'a Settings,
    /// How many blocks there are.
    pub count: Count,
    /// Margin of a block, as a share of its cell's side.
    pub margin: f64,
    /// What photographs may take of the host's memory.
    pub share: HostShare,
    /// Whether a few steps are timed on the device, by which times are predicted.
    pub timed: bool,
}

/// A plan, and what is to be told and drawn of it.
#[derive(Clone, Debug)]
pub struct Planned {
    /// The plan.
    pub file: PlanFile,
    /// Places on the ground that the surface was seen at, for the drawing.
    pub points: Vec<[f64; 2]>,
    /// Places of the cameras to train on.
    pub cameras: Vec<(String, [f64; 2])>,
    /// Splats that the whole is expected to need.
    pub splats: f64,
    /// Photographs to train on that see no point, and so are in no block.
    pub blind: usize,
}

/// Plans the blocks of a scene. Memory is counted on `gpu`; nothing runs there unless steps are timed.
pub fn plan(gpu: &Gpu, request: &PlanRequest<'_>) -> Result<Planned, Error> {
    let PlanRequest { dataset, settings, .. } = *request;
    let nowhere = || Error::NoSurface { dataset: dataset.path.clone() };
    if dataset.views_of(Role::Train).next().is_none() {
        return Err(Error::NoPhotographs { dataset: dataset.path.clone() });
    }
    let ground = Ground::of(dataset).ok_or_else(nowhere)?;
    let surface = Surface::of(dataset, &ground, &Frequency::new(settings, request.share))?;
    let total: f64 = surface.pieces.iter().map(|piece| piece.splats).sum();
    if !(total.is_finite() && total > 0.0) {
        return Err(nowhere());
    }
    let coarse = coarse_splats(total);
    let memory = Memory::new(gpu, dataset, settings, u64::from(coarse))?;
    let cut = Cut { surface: &surface, memory: &memory, margin: request.margin, views: dataset.views.len() };
    let parts = match request.count {
        Count::Blocks(count) => cut.parts_of(count, ROUNDS),
        Count::Within(limit) => cut.within(limit, total)?,
    };
    let chosen: Vec<&Chosen> = parts.iter().flat_map(|part| &part.photographs).collect();
    let mut used = vec![false; dataset.views.len()];
    chosen.iter().for_each(|(view, _)| used[*view as usize] = true);
    // Photographs are recorded with blocks, so the coarse model has those alone.
    let in_blocks = dataset.views_of(Role::Train).filter(|(at, _)| used[*at]);
    let in_blocks: Vec<String> = in_blocks.map(|(_, view)| view.name.clone()).collect();
    let records = photographs(dataset, &used, &request.share)?;
    let photographs = dataset.views_of(Role::Train).count();
    let blind = photographs - in_blocks.len();
    let global = global(dataset, settings, coarse, in_blocks);
    let steps = |count: usize| {
        let whole = f64::from(settings.run.iterations);
        ((whole * count as f64 / photographs as f64).ceil() as u32).max(1)
    };
    let seconds = if request.timed { timed(gpu, request, &surface, &parts) } else { None };
    let seconds = seconds.map(|each| move |part: &Measured| each(part) * f64::from(steps(part.photographs.len())));
    let block = |(at, part): (usize, &Measured)| Block {
        id: format!("b{at:02}"),
        cell: part.part.cell,
        margin: part.part.margin,
        photographs: part
            .photographs
            .iter()
            .filter_map(|(view, share)| {
                Some(PlannedPhotograph { share: *share, ..records.get(*view as usize)?.clone()? })
            })
            .collect(),
        steps: steps(part.photographs.len()),
        predicted_splats: part.splats.ceil() as u64,
        predicted_memory: part.memory,
        predicted_seconds: seconds.as_ref().map(|of| of(part)),
    };
    let blocks = parts.iter().enumerate().map(block).collect();
    let file = PlanFile {
        format: FORMAT.to_owned(),
        version: VERSION,
        program: env!("CARGO_PKG_VERSION").to_owned(),
        dataset: record(dataset)?,
        settings: settings.to_toml().map_err(crate::train::Error::from)?,
        seed: settings.run.seed,
        ground,
        global,
        blocks,
    };
    let place = |view: &View| (view.name.clone(), ground.place(view.camera.center()));
    let cameras = dataset.views_of(Role::Train).map(|(_, view)| place(view)).collect();
    let points = surface.pieces.iter().filter(|piece| piece.splats > 0.0).map(|piece| piece.place).collect();
    Ok(Planned { file, points, cameras, splats: total, blind })
}

/// Seconds of a step of a part, by those of the part with the median of splats, as in [`work`]. `None` where the device
/// does not tell times, or has no room.
fn timed(
    gpu: &Gpu,
    request: &PlanRequest<'_>,
    surface: &Surface,
    parts: &[Measured],
) -> Option<impl Fn(&Measured) -> f64 + use<>> {
    let mut order: Vec<&Measured> = parts.iter().collect();
    order.sort_by(|a, b| a.splats.total_cmp(&b.splats));
    let median = order.get(order.len() / 2)?;
    let Part { cell, margin } = median.part;
    let pieces: Vec<Piece> = surface.pieces.iter().filter(|p| cell.holds(p.place, margin)).copied().collect();
    let PlanRequest { dataset, settings, .. } = *request;
    let each = seconds_per_step(gpu, dataset, settings, &pieces, &median.photographs, median.splats).ok()??;
    let splats = median.splats;
    Some(move |part: &Measured| each * (0.5 + 0.5 * part.splats / splats))
}

/// A part of the ground with what its training takes.
#[derive(Clone)]
struct Measured {
    part: Part,
    photographs: Vec<Chosen>,
    splats: f64,
    memory: u64,
}

/// Cuts the ground and measures the parts.
struct Cut<'a> {
    surface: &'a Surface,
    memory: &'a Memory,
    margin: f64,
    views: usize,
}

impl Cut<'_> {
    /// The fewest parts that keep to a limit. Cells have equal splats, since the largest part decides.
    fn within(&self, wanted: Limit, total: f64) -> Result<Vec<Measured>, Error> {
        let (most, least) = match wanted {
            Limit::Splats(most) => (most, 0),
            Limit::Memory(most) => (most, self.memory.least()),
        };
        let takes = |part: &Measured| match wanted {
            Limit::Splats(_) => part.splats.ceil() as u64,
            Limit::Memory(_) => part.memory,
        };
        // Fewer blocks than this hold more than they may even without margins.
        let fewest = match wanted {
            Limit::Splats(most) => total / most.max(1) as f64,
            Limit::Memory(_) => 1.0,
        };
        let mut tried = fewest.ceil().clamp(1.0, MOST_BLOCKS as f64) as usize;
        loop {
            let parts = self.parts_of(tried, 0);
            let largest = parts.iter().map(takes).max().unwrap_or(0);
            if largest <= most {
                return Ok(parts);
            }
            if most <= least || parts.len() < tried || tried >= MOST_BLOCKS {
                let least = match wanted {
                    Limit::Splats(_) => Limit::Splats(largest),
                    Limit::Memory(_) => Limit::Memory(largest),
                };
                return Err(Error::TooSmall { wanted, blocks: parts.len(), least });
            }
            let over = (largest - least) as f64 / (most - least) as f64;
            tried = ((SURE * over * tried as f64) as usize).max(tried + 1).min(MOST_BLOCKS);
        }
    }

    /// Cells of equal splats are cut first. Blocks in the middle have more margin and photographs than those at the
    /// edge; their cells become smaller in a few further rounds, until the blocks take about equally long.
    fn parts_of(&self, count: usize, rounds: usize) -> Vec<Measured> {
        let pieces = &self.surface.pieces;
        let mut points: Vec<Weighted> =
            pieces.iter().map(|piece| Weighted { place: piece.place, work: piece.splats }).collect();
        let mut best = self.cut(&points, count);
        let mut last = best.clone();
        for _ in 0..rounds {
            let works = work(&last.iter().map(|part| (part.photographs.len(), part.splats)).collect::<Vec<_>>());
            for point in &mut points {
                let cell = last.iter().position(|part| part.part.cell.contains(point.place));
                let times = cell.and_then(|cell| works.get(cell)).map_or(1.0, |share| share * works.len() as f64);
                point.work *= times.max(0.1).powf(STEP);
            }
            last = self.cut(&points, count);
            if last.len() == best.len() && largest_work(&last) < largest_work(&best) {
                best.clone_from(&last);
            }
        }
        for part in &mut best {
            part.memory = self.memory.of(&part.photographs, part.splats);
        }
        best
    }

    /// The parts of a cut by the work of points, without their memory.
    fn cut(&self, points: &[Weighted], count: usize) -> Vec<Measured> {
        let part = |cell: Cell| Part { cell, margin: self.margin * side(cell, points) };
        let parts: Vec<Part> = partition(points, count).into_iter().map(part).collect();
        let photographs = choose(self.surface, &parts, self.views);
        let measured = |(part, photographs): (Part, Vec<Chosen>)| {
            let inside = self.surface.pieces.iter().filter(|piece| part.cell.holds(piece.place, part.margin));
            Measured { part, photographs, splats: inside.map(|piece| piece.splats).sum(), memory: 0 }
        };
        parts.into_iter().zip(photographs).map(measured).collect()
    }
}

/// The largest share of the work that a part has.
fn largest_work(parts: &[Measured]) -> f64 {
    let of: Vec<(usize, f64)> = parts.iter().map(|part| (part.photographs.len(), part.splats)).collect();
    work(&of).into_iter().fold(0.0, f64::max)
}

/// The share of each block of the time of all, by its looks (photographs or steps) and splats. A half of a step's time
/// goes by pixels, which are equal for all, and a half by splats.
pub(super) fn work(blocks: &[(usize, f64)]) -> Vec<f64> {
    let mean = blocks.iter().map(|(_, splats)| splats).sum::<f64>() / blocks.len().max(1) as f64;
    let of = |(looks, splats): &(usize, f64)| {
        let splats = if mean > 0.0 { splats / mean } else { 1.0 };
        (*looks).max(1) as f64 * (0.5 + 0.5 * splats)
    };
    let sum: f64 = blocks.iter().map(of).sum();
    blocks.iter().map(|block| of(block) / sum).collect()
}

/// Side of a square as large as what lies in a cell, or half the length of a line.
fn side(cell: Cell, points: &[Weighted]) -> f64 {
    let along = |axis: usize| {
        let mut inside: Vec<f64> = points
            .iter()
            .filter(|point| point.work > 0.0 && cell.contains(point.place))
            .map(|point| point.place[axis])
            .collect();
        inside.sort_unstable_by(f64::total_cmp);
        let strays = inside.len() / 200;
        match (inside.get(strays), inside.len().checked_sub(1 + strays).and_then(|last| inside.get(last))) {
            (Some(first), Some(last)) => (last - first).max(0.0),
            _ => 0.0,
        }
    };
    let (x, y) = (along(0), along(1));
    if x > 0.0 && y > 0.0 { x.sqrt() * y.sqrt() } else { 0.5 * x.max(y) }
}

/// Most splats of the coarse model of a scene that is expected to need `splats`.
fn coarse_splats(splats: f64) -> u32 {
    let (share, fewest) = COARSE_SPLATS;
    (share * splats).ceil().clamp(fewest as f64, f64::from(u32::MAX)) as u32
}

/// The coarse model of everything.
fn global(dataset: &Dataset, settings: &Settings, max_splats: u32, photographs: Vec<String>) -> GlobalModel {
    let full = dataset.views_of(Role::Train).map(|(_, view)| view.camera.width.max(view.camera.height)).max();
    let full = full.unwrap_or(1).min(settings.photographs.max_side);
    let side = (full / COARSE_SIDE.0).max(COARSE_SIDE.1.min(full));
    GlobalModel {
        photographs,
        max_side: side.max(1),
        steps: ((COARSE_STEPS * f64::from(settings.run.iterations)).ceil() as u32).max(1),
        max_splats,
    }
}

/// What a plan notes of its dataset.
fn record(dataset: &Dataset) -> Result<DatasetRecord, Error> {
    let mut files = Vec::with_capacity(dataset.files.len());
    for file in &dataset.files {
        files.push(file_record(&dataset.path, file)?);
    }
    Ok(DatasetRecord {
        path: dataset.path.clone(),
        model_sha256: hash::sha256_of_all(&files),
        photographs: dataset.views.len(),
        files,
    })
}

/// SHA-256 of the files of a dataset's model together, as a plan notes it.
pub fn model_sha256(dataset: &Dataset) -> Result<String, Error> {
    Ok(record(dataset)?.model_sha256)
}

/// The record of a file, by its path inside the dataset's folder, or by its name where it lies elsewhere.
fn file_record(folder: &Path, file: &Path) -> Result<FileRecord, Error> {
    let (sha256, bytes) = hash::sha256_of(file)?;
    let name = inside(folder, file).or_else(|| Some(file.file_name()?.to_str()?.to_owned())).unwrap_or_default();
    match is_inside(&name) {
        true => Ok(FileRecord { name, sha256, bytes }),
        false => Err(Error::Name { dataset: folder.to_owned(), name }),
    }
}

/// Path of a file inside a folder, with `/` between its parts.
fn inside(folder: &Path, file: &Path) -> Option<String> {
    let parts: Option<Vec<&str>> = file.strip_prefix(folder).ok()?.iter().map(|part| part.to_str()).collect();
    parts.map(|parts| parts.join("/")).filter(|name| is_inside(name))
}

/// The records of the photographs that blocks use; each file is read once.
fn photographs(dataset: &Dataset, used: &[bool], share: &HostShare) -> Result<Vec<Option<PlannedPhotograph>>, Error> {
    let of = |(view, used): (&View, &bool)| {
        if !used {
            return Ok(None);
        }
        if !is_inside(&view.name) {
            return Err(Error::Name { dataset: dataset.path.clone(), name: view.name.clone() });
        }
        let (sha256, bytes) = hash::sha256_of(&view.path)?;
        let mask = view.mask.as_deref().map(|mask| file_record(&dataset.path, mask)).transpose()?;
        let file = inside(&dataset.path, &view.path);
        Ok(Some(PlannedPhotograph { name: view.name.clone(), file, sha256, bytes, share: 0.0, mask }))
    };
    let all: Vec<(&View, &bool)> = dataset.views.iter().zip(used).collect();
    let costs = vec![1 << 18; all.len()];
    share.in_turns(&costs, |at| of(all[at])).into_iter().collect()
}
