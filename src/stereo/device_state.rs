//! The device side of a run of the matcher: its buffers and dispatches.

use super::homography::{self, Homography};
use super::{Error, InitialPlanes, Matcher, Prior, StereoView};
use crate::pass::stereo::{BlocksPush, FLAG_START, FilterPush, LINK_ROWS, MOST_CHECKS, RefitPush, SweepPush};
use crate::scene::Camera;
use crate::vk::{Buffer, Groups, Memory, Recorder, Ticket};

/// Pixels to each side whose depths a refit fits a plane to.
const REFIT_REACH: u32 = 3;
/// Refits before views are checked against each other.
const REFITS: u32 = 2;
/// Tolerance of the refits before the check, in units of the check's tolerance.
const LOOSE: f32 = 2.0;
/// Sweeps of a round after the first.
const LATER_SWEEPS: u32 = 1;
/// Turns (numbers of dispatches, which seed random draws) reserved for each round.
const TURNS: u32 = 1 << 16;

/// The views of a run with their device memory.
pub(super) struct DeviceState<'a> {
    matcher: &'a Matcher,
    views: &'a [StereoView],
    /// Pixels of the largest view.
    stride: usize,
    luma: Vec<Buffer>,
    /// Hypotheses and scores of each view.
    planes: Vec<Buffer>,
    /// The hypotheses of each view that passed the check.
    kept: Vec<Buffer>,
    /// Slots for a view and its sources: blocks of 2x2 pixels while matching, hypotheses while checking.
    slots: Buffer,
    links: Buffer,
    pixels: Buffer,
    refined: Buffer,
}

impl<'a> DeviceState<'a> {
    pub(super) fn new(matcher: &'a Matcher, views: &'a [StereoView]) -> Result<Self, Error> {
        let gpu = &matcher.gpu;
        let stride = views.iter().map(StereoView::pixels).max().unwrap_or(0);
        let buffer = |name: &str, bytes: usize| gpu.buffer(name, bytes as u64, Memory::Device);
        let mut work = Self {
            matcher,
            views,
            stride,
            luma: Vec::new(),
            planes: Vec::new(),
            kept: Vec::new(),
            slots: buffer("stereo slots", 16 * stride * (MOST_CHECKS + 1))?,
            links: buffer("stereo links", 16 * LINK_ROWS * MOST_CHECKS)?,
            pixels: buffer("stereo pixels", 4 * stride)?,
            refined: buffer("stereo refined", 16 * stride)?,
        };
        let mut recorder = gpu.recorder("stereo pictures")?;
        for view in views {
            let luma = buffer("stereo luma", 4 * view.pixels())?;
            recorder.upload(&luma, 0, bytemuck::cast_slice(&view.luma))?;
            work.luma.push(luma);
            work.planes.push(buffer("stereo planes", 16 * view.pixels())?);
            let kept = buffer("stereo kept", 16 * view.pixels())?;
            recorder.fill(&kept, 0)?;
            work.kept.push(kept);
        }
        recorder.submit()?;
        Ok(work)
    }

    /// Finds the hypotheses of a view. The first round starts from the view's initial planes; later rounds start from
    /// the kept hypotheses, which spread to other pixels.
    pub(super) fn matched(&self, number: usize, round: u32) -> Result<Ticket, Error> {
        let (view, planes, settings) = (&self.views[number], &self.planes[number], &self.matcher.settings);
        let sources = checks_of(view);
        let sources = &sources[..sources.len().min(settings.sources as usize)];
        let mut recorder = self.matcher.gpu.recorder("stereo")?;
        if sources.is_empty() {
            recorder.fill(planes, 0)?;
            return Ok(recorder.submit()?);
        }
        for (slot, picture) in std::iter::once(number).chain(sources.iter().copied()).enumerate() {
            let camera = &self.views[picture].camera;
            let push = BlocksPush { width: camera.width, height: camera.height, first: (slot * self.stride) as u32 };
            let threads = Groups::Items(self.views[picture].pixels() as u64);
            recorder.dispatch(&self.matcher.blocks, &[&self.luma[picture], &self.slots], &push, threads)?;
        }
        recorder.upload(&self.links, 0, bytemuck::cast_slice(&self.link_rows(number, sources)))?;
        let (list, light) = pixels(view);
        recorder.upload(&self.pixels, 0, bytemuck::cast_slice(&list))?;
        if round == 0 {
            recorder.upload(planes, 0, bytemuck::cast_slice(&view.start.rows(&view.camera)))?;
        } else {
            recorder.copy(&self.kept[number], 0, planes, 0, 16 * view.pixels() as u64)?;
        }
        let (draws, sweeps) = match (round, &view.start) {
            (0, InitialPlanes::Random) => {
                (settings.first_draws + settings.random_draws, settings.iterations + settings.random_iterations)
            }
            (0, InitialPlanes::Hypotheses(_)) => (settings.first_draws, settings.iterations),
            _ => (0, LATER_SWEEPS),
        };
        let push = self.push(number, sources);
        let bound = [&self.slots, &self.links, &self.pixels, planes];
        let all = list.len() as u32;
        let turn = TURNS * round;
        let start = SweepPush { count: all, draws, turn, flags: FLAG_START, ..push };
        recorder.dispatch(&self.matcher.sweep, &bound, &start, Groups::Items(u64::from(all)))?;
        let reach = settings.reach().max(1) as f32;
        // Later rounds continue with the amplitude that the first round ended with.
        let halved = if round == 0 { 0 } else { settings.iterations };
        for sweep in 0..sweeps {
            let amplitude = push.amplitude * 0.5_f32.powi((halved + sweep) as i32);
            for (colour, (first, count)) in [(0, light), (light, all - light)].into_iter().enumerate() {
                let turn = turn + 1 + 2 * sweep + colour as u32;
                let push = SweepPush { first, count, turn, amplitude, slope: amplitude / reach, ..push };
                recorder.dispatch(&self.matcher.sweep, &bound, &push, Groups::Items(u64::from(count)))?;
            }
        }
        for _ in 0..REFITS {
            self.refit(&mut recorder, &view.camera, planes, LOOSE)?;
            recorder.copy(&self.refined, 0, planes, 0, 16 * view.pixels() as u64)?;
        }
        Ok(recorder.submit()?)
    }

    /// Keeps the hypotheses of a view that its sources agree with.
    pub(super) fn checked(&self, number: usize) -> Result<(), Error> {
        let (view, settings) = (&self.views[number], &self.matcher.settings);
        // A source without hypotheses cannot agree or disagree.
        let has_planes = |s: &usize| !self.views[*s].sources.is_empty();
        let sources: Vec<usize> = checks_of(view).iter().copied().filter(has_planes).collect();
        if sources.is_empty() {
            return Ok(());
        }
        let mut recorder = self.matcher.gpu.recorder("stereo check")?;
        for (slot, picture) in std::iter::once(number).chain(sources.iter().copied()).enumerate() {
            let (at, bytes) = (16 * (slot * self.stride) as u64, 16 * self.views[picture].pixels() as u64);
            recorder.copy(&self.planes[picture], 0, &self.slots, at, bytes)?;
        }
        recorder.upload(&self.links, 0, bytemuck::cast_slice(&self.link_rows(number, &sources)))?;
        let few = sources.len() <= 2;
        let push = FilterPush {
            width: view.camera.width,
            height: view.camera.height,
            stride: self.stride as u32,
            sources: sources.len() as u32,
            needed: if few { settings.agree_sources.min(1) } else { settings.agree_sources },
            pixels: settings.agree_pixels,
            depth: settings.agree_depth,
            score: 1.0 + settings.least_ncc,
        };
        let bound = [&self.slots, &self.links, &self.kept[number]];
        recorder.dispatch(&self.matcher.filter, &bound, &push, Groups::Items(view.pixels() as u64))?;
        recorder.submit()?;
        Ok(())
    }

    /// Reads back the kept hypotheses of a view as a prior.
    pub(super) fn prior(&self, number: usize) -> Result<Prior, Error> {
        let view = &self.views[number];
        let mut recorder = self.matcher.gpu.recorder("stereo prior")?;
        self.refit(&mut recorder, &view.camera, &self.kept[number], 1.0)?;
        recorder.submit()?;
        let rows: Vec<[f32; 4]> = self.matcher.gpu.read_at(&self.refined, 0, view.pixels())?;
        Ok(Prior::new(&view.camera, &rows))
    }

    /// Refits each hypothesis to the neighbours within `loose` times the tolerance of the check.
    fn refit(&self, recorder: &mut Recorder, camera: &Camera, from: &Buffer, loose: f32) -> Result<(), Error> {
        let (width, height) = (camera.width, camera.height);
        let tolerance = loose * self.matcher.settings.agree_depth;
        let push = RefitPush { width, height, reach: REFIT_REACH, tolerance };
        let threads = Groups::Items(u64::from(width) * u64::from(height));
        Ok(recorder.dispatch(&self.matcher.refit, &[from, &self.refined], &push, threads)?)
    }

    fn push(&self, number: usize, sources: &[usize]) -> SweepPush {
        let (view, settings) = (&self.views[number], &self.matcher.settings);
        let camera = &view.camera;
        let sigma = settings.sigma_distance * settings.reach().max(1) as f32;
        SweepPush {
            width: camera.width,
            height: camera.height,
            stride: self.stride as u32,
            sources: sources.len() as u32,
            best: settings.best.min(sources.len() as u32),
            first: 0,
            count: 0,
            turn: 0,
            // A separate seed for each view: the same pixel of two views draws differently.
            seed: settings.seed.wrapping_mul(0x9e37_79b9).wrapping_add(number as u32),
            draws: settings.draws,
            flags: 0,
            focal_x: camera.fx as f32,
            focal_y: camera.fy as f32,
            centre_x: camera.cx as f32,
            centre_y: camera.cy as f32,
            least: (1.0 / view.depths[1]) as f32,
            most: (1.0 / view.depths[0]) as f32,
            amplitude: settings.amplitude * self.parallax_unit(view, sources),
            slope: 0.0,
            by_distance: 0.5 / (sigma * sigma),
            by_luma: 0.5 / (settings.sigma_luma * settings.sigma_luma),
            facing: settings.most_slanted.to_radians().cos(),
        }
    }

    fn link_rows(&self, number: usize, sources: &[usize]) -> Vec<[f32; 4]> {
        let camera = |view: usize| &self.views[view].camera;
        sources.iter().flat_map(|s| homography::rows(camera(number), camera(*s))).collect()
    }

    /// The change of inverse depth that moves the photograph's centre by one pixel in the sources (median).
    fn parallax_unit(&self, view: &StereoView, sources: &[usize]) -> f32 {
        let d = (view.depths[0] * view.depths[1]).sqrt().recip();
        let (u, v) = (0.5 * f64::from(view.camera.width), 0.5 * f64::from(view.camera.height));
        let moves = |s: &usize| Homography::new(&view.camera, &self.views[*s].camera).parallax(u, v, d);
        let mut moves: Vec<f64> = sources.iter().map(moves).collect();
        moves.sort_by(f64::total_cmp);
        let middle = moves.get(moves.len() / 2).copied().unwrap_or(0.0);
        // Views from one position have no parallax and no depth: any change will do.
        (1.0 / middle.max(1e-6 / d)) as f32
    }
}

fn checks_of(view: &StereoView) -> &[usize] {
    &view.sources[..view.sources.len().min(MOST_CHECKS)]
}

/// The pixels to match, one colour of the checkerboard first, and the number of pixels of that colour.
fn pixels(view: &StereoView) -> (Vec<u32>, u32) {
    let width = view.camera.width;
    let wanted = |p: &u32| view.wanted.as_ref().is_none_or(|w| w[*p as usize]);
    let of = |colour: u32| (0..view.pixels() as u32).filter(move |p| (p % width + p / width) % 2 == colour);
    let mut list: Vec<u32> = of(0).filter(wanted).collect();
    let light = list.len() as u32;
    list.extend(of(1).filter(wanted));
    (list, light)
}
