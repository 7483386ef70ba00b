//! Exposures of photographs on the device: applied between blend and loss, with an optimiser of their own.

use crate::pass::adam;
use crate::pass::exposure::{self, NUMBERS, ROW};
use crate::scene::ExposureMatrix;
use crate::train::Error;
use crate::vk::{self, Buffer, Gpu, Groups, Memory, Pipeline, Recorder};

/// The exposure's part of a step.
#[derive(Clone, Copy, Debug)]
pub(in crate::train) struct ExposureStep {
    /// Index of the photograph.
    pub(in crate::train) view: usize,
    /// Pixels that the step looks at.
    pub(in crate::train) pixels: u32,
    /// How many photographs have been looked at, this one included.
    pub(in crate::train) known: u32,
    /// How often this photograph has been looked at, this step included.
    pub(in crate::train) seen: u32,
    /// Learning rate.
    pub(in crate::train) rate: f64,
}

/// Matrices and moments of every photograph, and the passes that use them; see [`exposure`].
pub(in crate::train) struct Exposures {
    views: u32,
    rows: Buffer,
    parts: Buffer,
    exposed: Buffer,
    apply: Pipeline,
    backward: Pipeline,
    step: Pipeline,
    /// The state of exposures that stay as they are.
    fixed: Option<Vec<f32>>,
    settings: adam::AdamSettings,
}

impl Exposures {
    /// For `views` photographs of at most `pixels` pixels; contents undefined.
    pub(in crate::train) fn new(gpu: &Gpu, views: usize, pixels: u32) -> Result<Self, vk::Error> {
        let buffer = |name, bytes| gpu.buffer(name, bytes, Memory::Device);
        Ok(Self {
            views: views as u32,
            rows: buffer("exposures", 4 * exposure::floats(views) as u64)?,
            parts: buffer("exposure_parts", 4 * NUMBERS as u64 * u64::from(exposure::parts(pixels)))?,
            exposed: buffer("exposed", 16 * u64::from(pixels))?,
            apply: gpu.pipeline(&exposure::APPLY.kernel, &[])?,
            backward: gpu.pipeline(&exposure::BACKWARD.kernel, &[])?,
            step: gpu.pipeline(&exposure::STEP.kernel, &[])?,
            fixed: None,
            settings: adam::AdamSettings::default(),
        })
    }

    /// Gives every photograph a matrix, which stays. Call this before [`Self::begin`].
    pub(in crate::train) fn fix(&mut self, matrices: &[ExposureMatrix]) {
        let mut state = vec![0.0; exposure::floats(self.views as usize)];
        for (row, matrix) in state.chunks_exact_mut(ROW).zip(matrices) {
            for (k, (to, value)) in row.iter_mut().zip(matrix.iter().flatten()).enumerate() {
                *to = (value - identity(k / 4, k % 4)) as f32;
            }
        }
        self.fixed = Some(state);
    }

    /// Sets every matrix to what it was fixed to, else to the identity, and the moments to zero.
    pub(in crate::train) fn begin(&self, gpu: &Gpu) -> Result<(), vk::Error> {
        match &self.fixed {
            Some(state) => gpu.write(&self.rows, state),
            None => gpu.write(&self.rows, &vec![0.0_f32; exposure::floats(self.views as usize)]),
        }
    }

    fn push(&self, turn: ExposureStep) -> exposure::Push {
        exposure::Push { pixels: turn.pixels, view: turn.view as u32, views: self.views }
    }

    fn groups(turn: ExposureStep) -> Groups<'static> {
        Groups::Workgroups(u64::from(exposure::parts(turn.pixels)))
    }

    /// Records applying the photograph's exposure to the render; the loss compares the result.
    pub(in crate::train) fn record_apply(
        &self,
        recorder: &mut Recorder,
        image: &Buffer,
        turn: ExposureStep,
    ) -> Result<&Buffer, vk::Error> {
        let buffers = [image, &self.rows, &self.exposed];
        recorder.dispatch(&self.apply, &buffers, &self.push(turn), Self::groups(turn))?;
        Ok(&self.exposed)
    }

    /// Records the backward pass after the loss: turns the gradient of the exposed render, in `grad_image`, into that
    /// of the render, and steps the photograph's matrix. `once` dispatches one workgroup, or none when the event is
    /// lost.
    pub(in crate::train) fn record_backward(
        &self,
        recorder: &mut Recorder,
        image: &Buffer,
        grad_image: &Buffer,
        turn: ExposureStep,
        once: Option<Groups<'_>>,
    ) -> Result<(), vk::Error> {
        let buffers = [image, &self.rows, grad_image, &self.parts];
        recorder.dispatch(&self.backward, &buffers, &self.push(turn), Self::groups(turn))?;
        let Some(once) = once.filter(|_| self.fixed.is_none()) else { return Ok(()) };
        let (view, views) = (turn.view as u32, self.views);
        let counts = [turn.known.min(views), turn.seen];
        let push = exposure::StepPush::new(&self.settings, turn.pixels, [view, views], counts, turn.rate);
        recorder.dispatch(&self.step, &[&self.parts, &self.rows], &push, once)
    }

    /// Bytes of the buffers that depend on pixels, and bytes of the others.
    pub(in crate::train) fn bytes(&self) -> [u64; 2] {
        [self.exposed.size() + self.parts.size(), self.rows.size()]
    }

    /// Matrices and moments, for a restart. Waits.
    pub(in crate::train) fn state(&self, gpu: &Gpu) -> Result<Vec<f32>, vk::Error> {
        gpu.read_at(&self.rows, 0, exposure::floats(self.views as usize))
    }

    /// Writes a state of [`Self::state`].
    pub(in crate::train) fn restore(&self, gpu: &Gpu, state: &[f32]) -> Result<(), Error> {
        let expected = exposure::floats(self.views as usize);
        if state.len() != expected {
            return Err(Error::Checkpoint { section: "exposures".to_owned(), found: state.len(), expected });
        }
        Ok(gpu.write(&self.rows, state)?)
    }
}

fn identity(row: usize, column: usize) -> f64 {
    if row == column { 1.0 } else { 0.0 }
}

/// The photographs' matrices from a state of [`Exposures::state`].
pub(in crate::train) fn matrices(state: &[f32]) -> Vec<ExposureMatrix> {
    let views = (state.len() / ROW).saturating_sub(1);
    let matrix = |v: usize| {
        std::array::from_fn(|row| {
            std::array::from_fn(|column| {
                let k = 4 * row + column;
                identity(row, column) + f64::from(state[ROW * v + k]) - f64::from(state[ROW * views + k])
            })
        })
    };
    (0..views).map(matrix).collect()
}
