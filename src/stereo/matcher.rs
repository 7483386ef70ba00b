//! PatchMatch on the device, view by view, and the check of all views against each other.

use super::links::{self, Link};
use super::{Error, Prior, Settings, Start, View};
use crate::pass::Pass;
use crate::pass::stereo::{
    BLOCKS, BlocksPush, FILTER, FLAG_START, FilterPush, LINK_ROWS, MOST_CHECKS, REFIT, RefitPush, SWEEP_3, SWEEP_4,
    SWEEP_5, SWEEP_6, SweepPush,
};
use crate::scene::Camera;
use crate::vk::{Buffer, Gpu, Groups, Memory, Pipeline, Recorder, Ticket};

/// Views whose work may be under way at once.
const IN_FLIGHT: usize = 3;
/// Pixels to each side through whose depths a plane is laid in the end.
const REFIT_REACH: u32 = 3;
/// How often that is done before views are checked against each other.
const REFITS: u32 = 2;

/// Matches views on a device.
pub struct Matcher {
    gpu: Gpu,
    settings: Settings,
    blocks: Pipeline,
    sweep: Pipeline,
    filter: Pipeline,
    refit: Pipeline,
}

/// Memory that all views of a run share.
struct Room {
    /// Pixels of the largest view.
    stride: usize,
    /// A view and its sources: as rows of 2x2 pixels, later as hypotheses.
    slots: Buffer,
    links: Buffer,
    pixels: Buffer,
    kept: Buffer,
    refined: Buffer,
}

impl Matcher {
    /// Compiles the passes.
    pub fn new(gpu: &Gpu, settings: &Settings) -> Result<Self, Error> {
        settings.check()?;
        let sweep: &Pass = match settings.taps {
            3 => &SWEEP_3,
            4 => &SWEEP_4,
            5 => &SWEEP_5,
            _ => &SWEEP_6,
        };
        Ok(Self {
            gpu: gpu.clone(),
            settings: settings.clone(),
            blocks: gpu.pipeline(&BLOCKS.kernel, &[])?,
            sweep: gpu.pipeline(&sweep.kernel, &[("STEP", settings.step)])?,
            filter: gpu.pipeline(&FILTER.kernel, &[])?,
            refit: gpu.pipeline(&REFIT.kernel, &[])?,
        })
    }

    /// Depth, normals and confidence of every view, at the sizes of the views' cameras; nothing is known of views without sources.
    /// `done` hears the number of views that are matched. Equal inputs give equal bits on one device.
    pub fn run(&self, views: &[View], mut done: impl FnMut(usize)) -> Result<Vec<Prior>, Error> {
        for (number, view) in views.iter().enumerate() {
            view.check(number, views.len())?;
        }
        let Some(stride) = views.iter().map(View::pixels).max().filter(|n| *n > 0) else {
            return Ok(views.iter().map(|view| Prior::new(&view.camera, &[])).collect());
        };
        let room = self.room(stride)?;
        let (mut luma, mut planes) = (Vec::new(), Vec::new());
        for view in views {
            let buffer = self.gpu.buffer("stereo luma", 4 * view.pixels() as u64, Memory::Device)?;
            self.gpu.write(&buffer, &view.luma)?;
            luma.push(buffer);
            planes.push(self.gpu.buffer("stereo planes", 16 * view.pixels() as u64, Memory::Device)?);
        }
        let mut tickets: Vec<Ticket> = Vec::new();
        for (number, planes) in planes.iter().enumerate() {
            tickets.push(self.matched(views, number, &luma, planes, &room)?);
            if let Some(oldest) = tickets.len().checked_sub(IN_FLIGHT) {
                self.gpu.wait(tickets[oldest])?;
            }
            done(number + 1);
        }
        drop(luma);
        (0..views.len()).map(|number| self.checked(views, number, &planes, &room)).collect()
    }

    fn room(&self, stride: usize) -> Result<Room, Error> {
        let buffer = |name: &str, bytes: usize| self.gpu.buffer(name, bytes as u64, Memory::Device);
        Ok(Room {
            stride,
            slots: buffer("stereo slots", 16 * stride * (MOST_CHECKS + 1))?,
            links: buffer("stereo links", 16 * LINK_ROWS * MOST_CHECKS)?,
            pixels: buffer("stereo pixels", 4 * stride)?,
            kept: buffer("stereo kept", 16 * stride)?,
            refined: buffer("stereo refined", 16 * stride)?,
        })
    }

    /// Finds the hypotheses of a view.
    fn matched(
        &self,
        views: &[View],
        number: usize,
        luma: &[Buffer],
        planes: &Buffer,
        room: &Room,
    ) -> Result<Ticket, Error> {
        let view = &views[number];
        let sources = checks_of(view);
        let sources = &sources[..sources.len().min(self.settings.sources as usize)];
        let mut recorder = self.gpu.recorder("stereo")?;
        recorder.fill(planes, 0)?;
        if sources.is_empty() {
            return Ok(recorder.submit()?);
        }
        for (slot, picture) in std::iter::once(number).chain(sources.iter().copied()).enumerate() {
            let camera = &views[picture].camera;
            let push = BlocksPush { width: camera.width, height: camera.height, first: (slot * room.stride) as u32 };
            let threads = views[picture].pixels() as u64;
            recorder.dispatch(&self.blocks, &[&luma[picture], &room.slots], &push, Groups::Items(threads))?;
        }
        recorder.upload(&room.links, 0, bytemuck::cast_slice(&link_rows(views, number, sources)))?;
        let (list, light) = pixels(view);
        recorder.upload(&room.pixels, 0, bytemuck::cast_slice(&list))?;
        recorder.upload(planes, 0, bytemuck::cast_slice(&view.start.rows(&view.camera)))?;
        let push = self.push(view, views, number, sources, room);
        let bound = [&room.slots, &room.links, &room.pixels, planes];
        let all = list.len() as u32;
        let settings = &self.settings;
        let (draws, iterations) = match view.start {
            Start::Random => {
                (settings.first_draws + settings.random_draws, settings.iterations + settings.random_iterations)
            }
            Start::Hypotheses(_) => (settings.first_draws, settings.iterations),
        };
        let start = SweepPush { count: all, draws, flags: FLAG_START, ..push };
        recorder.dispatch(&self.sweep, &bound, &start, Groups::Items(u64::from(all)))?;
        let reach = self.settings.reach().max(1) as f32;
        for iteration in 0..iterations {
            let amplitude = push.amplitude * 0.5_f32.powi(iteration as i32);
            for (colour, (first, count)) in [(0, light), (light, all - light)].into_iter().enumerate() {
                let turn = 1 + 2 * iteration + colour as u32;
                let sweep = SweepPush { first, count, turn, amplitude, slope: amplitude / reach, flags: 0, ..push };
                recorder.dispatch(&self.sweep, &bound, &sweep, Groups::Items(u64::from(count)))?;
            }
        }
        for _ in 0..REFITS {
            self.refit(&mut recorder, &view.camera, planes, &room.refined, 2.0)?;
            recorder.copy(&room.refined, 0, planes, 0, 16 * view.pixels() as u64)?;
        }
        Ok(recorder.submit()?)
    }

    /// Lays planes through what lies within `loose` times the tolerance of the check.
    fn refit(
        &self,
        recorder: &mut Recorder,
        camera: &Camera,
        from: &Buffer,
        to: &Buffer,
        loose: f32,
    ) -> Result<(), Error> {
        let (width, height) = (camera.width, camera.height);
        let push = RefitPush { width, height, reach: REFIT_REACH, tolerance: loose * self.settings.agree_depth };
        let threads = Groups::Items(u64::from(width) * u64::from(height));
        Ok(recorder.dispatch(&self.refit, &[from, to], &push, threads)?)
    }

    fn push(&self, view: &View, views: &[View], number: usize, sources: &[usize], room: &Room) -> SweepPush {
        let (settings, camera) = (&self.settings, &view.camera);
        let reach = settings.reach().max(1) as f32;
        let sigma = settings.sigma_distance * reach;
        SweepPush {
            width: camera.width,
            height: camera.height,
            stride: room.stride as u32,
            sources: sources.len() as u32,
            best: settings.best.min(sources.len() as u32),
            first: 0,
            count: 0,
            turn: 0,
            // Of its own for each view: equal pixels of two views draw differently.
            seed: settings.seed.wrapping_mul(0x9e37_79b9).wrapping_add(number as u32),
            draws: settings.draws,
            flags: 0,
            focal_x: camera.fx as f32,
            focal_y: camera.fy as f32,
            centre_x: camera.cx as f32,
            centre_y: camera.cy as f32,
            least: (1.0 / view.depths[1]) as f32,
            most: (1.0 / view.depths[0]) as f32,
            amplitude: settings.amplitude * parallax_unit(view, views, sources),
            slope: 0.0,
            by_distance: 0.5 / (sigma * sigma),
            by_luma: 0.5 / (settings.sigma_luma * settings.sigma_luma),
            facing: settings.most_slanted.to_radians().cos(),
        }
    }

    /// Keeps what the sources agree with, and fetches it.
    fn checked(&self, views: &[View], number: usize, planes: &[Buffer], room: &Room) -> Result<Prior, Error> {
        let view = &views[number];
        // A source without hypotheses has nothing to say.
        let sources: Vec<usize> = checks_of(view).iter().copied().filter(|s| !views[*s].sources.is_empty()).collect();
        if sources.is_empty() {
            let none = vec![[0.0; 4]; view.pixels()];
            return Ok(Prior::new(&view.camera, &none));
        }
        let mut recorder = self.gpu.recorder("stereo check")?;
        for (slot, picture) in std::iter::once(number).chain(sources.iter().copied()).enumerate() {
            let (at, bytes) = (16 * (slot * room.stride) as u64, 16 * views[picture].pixels() as u64);
            recorder.copy(&planes[picture], 0, &room.slots, at, bytes)?;
        }
        recorder.upload(&room.links, 0, bytemuck::cast_slice(&link_rows(views, number, &sources)))?;
        let few = sources.len() <= 2;
        let push = FilterPush {
            width: view.camera.width,
            height: view.camera.height,
            stride: room.stride as u32,
            sources: sources.len() as u32,
            needed: if few { self.settings.agree_sources.min(1) } else { self.settings.agree_sources },
            pixels: self.settings.agree_pixels,
            depth: self.settings.agree_depth,
            score: 1.0 + self.settings.least_ncc,
        };
        let threads = Groups::Items(view.pixels() as u64);
        recorder.dispatch(&self.filter, &[&room.slots, &room.links, &room.kept], &push, threads)?;
        self.refit(&mut recorder, &view.camera, &room.kept, &room.refined, 1.0)?;
        recorder.submit()?;
        let rows: Vec<[f32; 4]> = self.gpu.read_at(&room.refined, 0, view.pixels())?;
        Ok(Prior::new(&view.camera, &rows))
    }
}

fn checks_of(view: &View) -> &[usize] {
    &view.sources[..view.sources.len().min(MOST_CHECKS)]
}

fn link_rows(views: &[View], number: usize, sources: &[usize]) -> Vec<[f32; 4]> {
    sources.iter().flat_map(|s| links::rows(&views[number].camera, &views[*s].camera)).collect()
}

/// The pixels that are matched, those of one colour of the checkerboard first, and how many these are.
fn pixels(view: &View) -> (Vec<u32>, u32) {
    let width = view.camera.width;
    let wanted = |p: &u32| view.wanted.as_ref().is_none_or(|w| w[*p as usize]);
    let of = |colour: u32| (0..view.pixels() as u32).filter(move |p| (p % width + p / width) % 2 == colour);
    let mut list: Vec<u32> = of(0).filter(wanted).collect();
    let light = list.len() as u32;
    list.extend(of(1).filter(wanted));
    (list, light)
}

/// The change of inverse depth that moves the middle of the picture by a pixel in the sources, in the median.
fn parallax_unit(view: &View, views: &[View], sources: &[usize]) -> f32 {
    let d = (view.depths[0] * view.depths[1]).sqrt().recip();
    let (u, v) = (0.5 * f64::from(view.camera.width), 0.5 * f64::from(view.camera.height));
    let mut moves: Vec<f64> =
        sources.iter().map(|s| Link::new(&view.camera, &views[*s].camera).parallax(u, v, d)).collect();
    moves.sort_by(f64::total_cmp);
    let middle = moves.get(moves.len() / 2).copied().unwrap_or(0.0);
    // Where nothing moves, as in views from one place, no depth can be told: any change is as good.
    (1.0 / middle.max(1e-6 / d)) as f32
}
