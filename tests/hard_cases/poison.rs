//! Numbers that are NaN, infinite, denormal or huge, in every parameter of a splat: through forward pass, backward
//! pass, optimiser step and density change of a training.

use psrgs_vk::pass::camera::{CameraPush, NEAR, Projection};
use psrgs_vk::raster::PLANES;
use psrgs_vk::scene::tile::TileGrid;
use psrgs_vk::train::{Input, Message, Pacing, Restart, Settings, State, Trainer};
use psrgs_vk::twin::project::{Culled, project};
use psrgs_vk::twin::splat::{PARAMETERS, Splat, TwinCamera};
use psrgs_vk::vk::Gpu;

use super::common;
use super::common::plane_scene;
use super::training::{by_identity, run, settings};

/// Splats with an identity below this are the victims, each for one parameter.
const VICTIMS: u32 = PARAMETERS as u32;

fn input() -> Input {
    plane_scene::input(4, 48, 36, PARAMETERS + 160)
}

fn schedule() -> Settings {
    let mut s = settings(48);
    // Every band is in use from the third step on.
    s.model.sh_interval = 1;
    s.density.densify_interval = 12;
    s.density.opacity_reset_interval = 20;
    s
}

/// A training after a few steps, before any change of density.
fn young(gpu: &Gpu, settings: &Settings) -> (Restart, Trainer) {
    let pacing = Pacing { events_in_flight: 1, ..Pacing::default() };
    let mut trainer = Trainer::new(gpu, input(), settings, pacing, None).expect("trainer");
    run(&mut trainer, 6);
    let restart = trainer.snapshot().expect("snapshot");
    assert!((6..10).contains(&restart.step));
    (restart, trainer)
}

/// Parameter `k` of the splat in row `i` of planes.
fn parameter(planes: &mut [Vec<f32>; 8], i: usize, k: usize) -> &mut f32 {
    let mut first = 0;
    let plane = PLANES.iter().position(|(_, row)| {
        first += *row as usize;
        k < first
    });
    let plane = plane.expect("59 parameters");
    let row = PLANES[plane].1 as usize;
    &mut planes[plane][row * i + k + row - first]
}

/// The state with every victim's own parameter set.
fn poisoned(state: &State, value: impl Fn(f32) -> f32) -> State {
    let mut out = state.clone();
    for (i, id) in state.ids.iter().enumerate().filter(|(_, id)| **id < VICTIMS) {
        let at = parameter(&mut out.params, i, *id as usize);
        *at = value(*at);
    }
    out
}

/// The state without the victims.
fn without(state: &State) -> State {
    let kept: Vec<usize> = (0..state.ids.len()).filter(|i| state.ids[*i] >= VICTIMS).collect();
    let rows = |plane: &Vec<f32>, row: usize| -> Vec<f32> {
        kept.iter().flat_map(|i| plane[row * i..row * (i + 1)].iter().copied()).collect()
    };
    let planes = |planes: &[Vec<f32>; 8]| std::array::from_fn(|p| rows(&planes[p], PLANES[p].1 as usize));
    let mut counters = state.counters.clone();
    counters[psrgs_vk::pass::counters::SPLATS] = kept.len() as u32;
    State {
        params: planes(&state.params),
        ids: kept.iter().map(|i| state.ids[*i]).collect(),
        moments: state.moments.iter().map(planes).collect(),
        stats: rows(&state.stats, 4),
        counters,
        ..state.clone()
    }
}

/// A training that continues from another state.
fn from(gpu: &Gpu, settings: &Settings, restart: &Restart, state: State) -> Trainer {
    let restart = Restart { state, ..restart.clone() };
    Trainer::new(gpu, input(), settings, Pacing::default(), Some(restart)).expect("trainer")
}

/// A training that continues from another state to its end.
fn resumed(gpu: &Gpu, settings: &Settings, restart: &Restart, state: State) -> (State, super::training::Told) {
    let mut trainer = from(gpu, settings, restart, state);
    let told = run(&mut trainer, u32::MAX);
    (super::training::state(&mut trainer), told)
}

/// Number of splats that the twin leaves out of a view because of a number that is not finite.
fn bad(state: &State, trainer: &Trainer, step: u32) -> usize {
    let camera = input().train[trainer.schedule().view_at(step)].camera;
    let projection = Projection {
        sh_degree: 3,
        near: NEAR,
        antialias: false,
        reference_clamp: true,
        black_learns: false,
        orthographic: false,
        limits: None,
        alpha_cutoff: None,
    };
    let view = TwinCamera::<f32>::of(&CameraPush::new(&camera, &projection));
    let side = trainer.variants().tile.size();
    let grid = TileGrid::new(view.size, [side; 2]);
    let mut planes = state.params.clone();
    (0..state.ids.len())
        .filter(|i| {
            let values = std::array::from_fn(|k| *parameter(&mut planes, *i, k));
            matches!(project(&Splat::from_array(&values), &view, Some(&grid)), Err(Culled::Bad))
        })
        .count()
}

/// Bad splats have no effect on others: all others train, grow and are pruned to the same bits as without the bad
/// splats. Bad splats are counted, reported, and dropped by the next change of density.
#[test]
fn splats_that_are_not_numbers_leave_no_trace_in_others() {
    let Some(gpu) = common::gpu() else { return };
    let settings = schedule();
    let (restart, trainer) = young(&gpu, &settings);
    let (clean, clean_told) = resumed(&gpu, &settings, &restart, without(&restart.state));
    assert!(clean_told.grown() > 0 && clean_told.warnings.is_empty(), "{:?}", clean_told.warnings);
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let what = value.to_string();
        let state = poisoned(&restart.state, |_| value);
        let found = bad(&state, &trainer, restart.step + 1);
        assert!(found >= 11, "{what}: {found} splats");
        let (end, told) = resumed(&gpu, &settings, &restart, state);
        assert_eq!(told.losses, clean_told.losses, "{what}: losses");
        let (a, b) = (by_identity(&end), by_identity(&clean));
        assert_eq!(a.len(), b.len(), "{what}: splats");
        for (id, row) in &b {
            assert!(a.get(id) == Some(row), "{what}: splat {id} differs");
        }
        assert!(end.params.iter().flatten().all(|v| v.is_finite()), "{what}");
        assert_eq!(told.warnings.len(), 1, "{what}: {:?}", told.warnings);
        assert!(
            told.warnings[0].contains(&format!(" {}", psrgs_vk::numbers::counted(found, "splat"))),
            "{what}: {found}, {}",
            told.warnings[0]
        );
        let [first, want] = [&told, &clean_told].map(|told| told.changes[0]);
        assert_eq!(first, [want[0], want[1], want[2] + VICTIMS], "{what}: grown and pruned");
    }
    gpu.check_canaries().unwrap();
    common::assert_no_messages(&gpu);
}

/// Training with denormals equals training with zeros in their place: bit for bit above zero. Below zero an exponential
/// may round differently than at zero, and training amplifies the difference, so that only the first step is compared.
#[test]
fn denormals_are_as_good_as_zero() {
    let Some(gpu) = common::gpu() else { return };
    let settings = schedule();
    let (restart, _) = young(&gpu, &settings);
    let (want, want_told) = resumed(&gpu, &settings, &restart, poisoned(&restart.state, |_| 0.0));
    for value in [1e-40f32, 1e-45, -1e-40, -1e-45] {
        let (got, told) = resumed(&gpu, &settings, &restart, poisoned(&restart.state, |_| value));
        assert!(told.warnings.is_empty(), "{value:e}: {:?}", told.warnings);
        assert!(got.params.iter().flatten().all(|v| v.is_finite()), "{value:e}");
        assert!((told.losses[0] / want_told.losses[0] - 1.0).abs() < 1e-6, "{value:e}");
        if value > 0.0 {
            assert_eq!(told.losses, want_told.losses, "{value:e}");
            assert_eq!((&got.ids, &told.changes), (&want.ids, &want_told.changes), "{value:e}");
            for (a, b) in got.params.iter().zip(&want.params) {
                assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-30), "{value:e}");
            }
        }
    }
}

/// The largest numbers of f32. In mean, quaternion, scale and opacity, the splat is culled or drawn without other
/// effects. A colour of 1e38 is valid, and a loss that is not finite ends the training with a message.
#[test]
fn huge_numbers_are_culled_or_end_the_training() {
    let Some(gpu) = common::gpu() else { return };
    let settings = schedule();
    let (restart, _) = young(&gpu, &settings);
    let some = |value: f32, geometry: bool| {
        let mut state = restart.state.clone();
        for (i, id) in restart.state.ids.iter().enumerate() {
            if *id < VICTIMS && (*id < 11) == geometry {
                *parameter(&mut state.params, i, *id as usize) = value;
            }
        }
        state
    };
    for value in [f32::MAX, f32::MIN, 1e20, -1e20, 88.0, -88.0] {
        let (end, told) = resumed(&gpu, &settings, &restart, some(value, true));
        assert!(told.losses.iter().all(|l| l.is_finite()), "{value:e}");
        assert!(end.params.iter().flatten().all(|v| v.is_finite()), "{value:e}");
        let others = end.ids.iter().filter(|id| **id >= VICTIMS).count();
        assert!(others > 100, "{value:e}: {others} others left");
    }
    for value in [1e30, f32::MAX] {
        let mut trainer = from(&gpu, &settings, &restart, some(value, false));
        let ended = loop {
            match trainer.next_message() {
                Ok(Some(Message::Step { loss, .. })) => assert!(loss.is_finite()),
                Ok(Some(_)) => {}
                Ok(None) => break String::new(),
                Err(error) => break error.to_string(),
            }
        };
        assert!(ended.is_empty() || ended.contains("finite"), "{value:e}: {ended}");
        println!("colours of {value:e}: {}", if ended.is_empty() { "trained to the end" } else { &ended });
    }
    common::assert_no_messages(&gpu);
}

/// Moments that are not numbers spoil their own splats, which the next change of density drops.
#[test]
fn moments_that_are_not_numbers_spoil_their_own_splats() {
    let Some(gpu) = common::gpu() else { return };
    let settings = schedule();
    let (restart, _) = young(&gpu, &settings);
    for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX] {
        for of in 0..2 {
            let mut state = restart.state.clone();
            for (i, id) in restart.state.ids.iter().enumerate().filter(|(_, id)| **id < VICTIMS) {
                *parameter(&mut state.moments[of], i, *id as usize) = value;
            }
            let (end, told) = resumed(&gpu, &settings, &restart, state);
            assert!(told.losses.iter().all(|l| l.is_finite()), "{value}, moment {of}");
            let others = end.ids.iter().filter(|id| **id >= VICTIMS).count();
            assert!(others > 100, "{value}, moment {of}: {others} others left");
            assert!(end.params.iter().flatten().all(|v| v.is_finite()), "{value}, moment {of}");
        }
    }
}
