//! Photographs of reduced size.

use crate::dataset::Depth;
use crate::loss::Photograph;
use crate::pass::photograph_reduce as pass;
use crate::scene::Camera;
use crate::train::Error;
use crate::vk::{self, Buffer, Gpu, Groups, Memory, Pipeline, Recorder};

/// Buffer for a reduced photograph, and the pass that reduces.
pub(in crate::train) struct Coarse {
    reduced: Buffer,
    eight: Pipeline,
    sixteen: Option<Pipeline>,
}

impl Coarse {
    /// For photographs of at most `pixels` pixels, `deep` if some have 16 bits per channel.
    pub(in crate::train) fn new(gpu: &Gpu, pixels: u32, deep: bool) -> Result<Self, vk::Error> {
        let pipeline = |depth: Depth| gpu.pipeline(&pass::PASS.kernel, &[("PHOTOGRAPH_BITS", depth.bits())]);
        let depth = if deep { Depth::Sixteen } else { Depth::Eight };
        Ok(Self {
            reduced: gpu.buffer(
                "reduced photograph",
                u64::from(pixels / 4 + 1) * depth.bytes_per_pixel(),
                Memory::Device,
            )?,
            eight: pipeline(Depth::Eight)?,
            sixteen: deep.then(|| pipeline(Depth::Sixteen)).transpose()?,
        })
    }

    /// The camera of a photograph reduced by `factor`. Columns and rows that do not fill a reduced pixel are left out.
    pub(in crate::train) fn camera(camera: &Camera, factor: u32) -> Camera {
        let by = f64::from(factor.max(1));
        Camera {
            fx: camera.fx / by,
            fy: camera.fy / by,
            cx: camera.cx / by,
            cy: camera.cy / by,
            width: camera.width / factor.max(1),
            height: camera.height / factor.max(1),
            ..*camera
        }
    }

    /// Records reducing the photograph by `factor`, at least 2, and returns the reduced photograph.
    pub(in crate::train) fn record<'a>(
        &'a self,
        recorder: &mut Recorder,
        camera: &Camera,
        photograph: &Photograph<'a>,
        factor: u32,
    ) -> Result<Photograph<'a>, Error> {
        let pipeline = self.sixteen.as_ref().filter(|_| photograph.bits == 16).unwrap_or(&self.eight);
        let push = pass::Push { width: camera.width, height: camera.height, factor };
        let small = Self::camera(camera, factor);
        let pixels = u64::from(small.width) * u64::from(small.height);
        recorder.dispatch(pipeline, &[photograph.buffer, &self.reduced], &push, Groups::Items(pixels))?;
        // The share of masked pixels is taken from the whole photograph.
        let all = f64::from(camera.width) * f64::from(camera.height);
        let values = (f64::from(photograph.values) * pixels as f64 / all) as f32;
        let size = (small.width, small.height);
        Ok(Photograph { buffer: &self.reduced, size, values, part_values: values, ..*photograph })
    }

    /// Bytes of the buffer.
    pub(in crate::train) fn bytes(&self) -> u64 {
        self.reduced.size()
    }
}
