//! Depth and normals against priors.

use super::Compared;
use crate::dataset::Depth;
use crate::pass::{geometry as pass, part_sum};
use crate::raster::Target;
use crate::scene::Camera;
use crate::stereo::Prior;
use crate::train::Error;
use crate::train::settings::Geometry as Weights;
use crate::vk::{self, Buffer, BufferSlice, Gpu, Groups, Memory, Pipeline, Recorder};

/// Priors of all views on the device, and the passes that compare with them.
pub(in crate::train) struct Geometry {
    priors: Buffer,
    places: Vec<Place>,
    depth_map: Buffer,
    parts: Buffer,
    sums: Buffer,
    grad_aux: Buffer,
    eight: Pipeline,
    sixteen: Option<Pipeline>,
    grad: Pipeline,
    sum: Pipeline,
    weights: Weights,
}

/// Where a view's prior is.
struct Place {
    first: u64,
    width: u32,
    height: u32,
    /// Median depth; 0 where nothing is known of the view.
    median: f32,
}

impl Place {
    fn bytes(&self) -> u64 {
        8 * u64::from(self.width) * u64::from(self.height)
    }
}

/// One view's turn.
#[derive(Clone, Copy)]
pub(in crate::train) struct GeometryTurn {
    pub(in crate::train) view: usize,
    /// What all of its weights are multiplied by.
    pub(in crate::train) weight: f64,
}

impl Geometry {
    /// For views of these cameras with nothing known of any; `deep` if some photographs have 16 bits per channel, `masked` if there are
    /// masks.
    pub(in crate::train) fn new(
        gpu: &Gpu,
        cameras: &[Camera],
        deep: bool,
        masked: bool,
        weights: &Weights,
    ) -> Result<Self, vk::Error> {
        let alignment = gpu.caps().limits.storage_alignment.max(8);
        let mut end = 0;
        let place = |camera: &Camera| {
            let (width, height) = weights.prior_size(camera.width, camera.height);
            let place = Place { first: end, width, height, median: 0.0 };
            end = (end + place.bytes()).next_multiple_of(alignment);
            place
        };
        let places: Vec<Place> = cameras.iter().map(place).collect();
        let most = |f: fn(u32, u32) -> u32| cameras.iter().map(|c| f(c.width, c.height)).max().unwrap_or(1);
        let (pixels, parts) = (u64::from(most(|w, h| w * h)), u64::from(most(pass::parts)));
        let buffer = |name, bytes: u64| gpu.buffer(name, bytes.max(16), Memory::Device);
        let depth = |depth: Depth| {
            let constants = [("MASK", u32::from(masked)), ("PHOTOGRAPH_BITS", depth.bits())];
            gpu.pipeline(&pass::DEPTH.kernel, &constants)
        };
        Ok(Self {
            priors: buffer("priors", end)?,
            places,
            depth_map: buffer("depth_map", 16 * pixels)?,
            parts: buffer("geometry_parts", 16 * parts)?,
            sums: buffer("geometry_sums", 16)?,
            grad_aux: buffer("grad_aux", 16 * pixels)?,
            eight: depth(Depth::Eight)?,
            sixteen: deep.then(|| depth(Depth::Sixteen)).transpose()?,
            grad: gpu.pipeline(&pass::GRAD.kernel, &[("EDGES", 0)])?,
            sum: gpu.pipeline(&part_sum::PASS.kernel, &[])?,
            weights: weights.clone(),
        })
    }

    /// Uploads what is known of the views, in their order; those that are missing stay unknown.
    pub(in crate::train) fn fill(&mut self, gpu: &Gpu, priors: &[Option<Prior>]) -> Result<(), Error> {
        for (place, prior) in self.places.iter_mut().zip(priors) {
            let Some(prior) = prior.as_ref().filter(|p| (p.width, p.height) == (place.width, place.height)) else {
                continue;
            };
            let mut depths: Vec<f32> = prior.depth.iter().copied().filter(|d| *d > 0.0 && d.is_finite()).collect();
            if depths.is_empty() {
                continue;
            }
            let middle = depths.len() / 2;
            place.median = *depths.select_nth_unstable_by(middle, f32::total_cmp).1;
            let known = |n: &[f32; 3]| n.iter().any(|v| *v != 0.0).then_some(*n);
            let words: Vec<[u32; 2]> = (0..prior.depth.len())
                .map(|k| pass::pack_prior(prior.depth[k], known(&prior.normals[k]), prior.confidence[k]))
                .collect();
            let mut recorder = gpu.recorder("prior")?;
            recorder.upload(&self.priors, place.first, bytemuck::cast_slice(&words))?;
            recorder.submit()?;
        }
        Ok(())
    }

    /// Whether anything is known of a view.
    pub(in crate::train) fn knows(&self, view: usize) -> bool {
        self.places.get(view).is_some_and(|place| place.median > 0.0)
    }

    /// Records the gradients of the geometry of a view that is known, which the forward pass rendered with its auxiliary image. They
    /// are added to the gradient of the transmittance; gives those of the auxiliary image.
    pub(in crate::train) fn record(
        &self,
        recorder: &mut Recorder,
        target: &Target,
        compared: &Compared<'_>,
        turn: GeometryTurn,
    ) -> Result<&Buffer, Error> {
        let place = self.places.get(turn.view).ok_or(Error::NoViews)?;
        let ((width, height), [mask_width, mask_height]) = (compared.size(), compared.mask_size());
        let weights = &self.weights;
        let of = |weight: f64| (weight * turn.weight) as f32;
        let push = pass::Push {
            width,
            height,
            prior_width: place.width,
            prior_height: place.height,
            mask_width,
            mask_height,
            pixels: compared.photograph.values / 3.0,
            median: place.median,
            depth_weight: of(weights.lambda_depth),
            huber: weights.depth_huber as f32,
            edge: weights.depth_edges as f32,
            smooth_weight: of(weights.lambda_depth * weights.lambda_smooth),
            edge_stop: weights.smooth_edge_stop as f32,
            cosine_weight: of(weights.lambda_normal),
            l1_weight: of(weights.lambda_normal),
        };
        let pipeline = match (compared.photograph.depth, &self.sixteen) {
            (Depth::Sixteen, Some(pipeline)) => pipeline,
            _ => &self.eight,
        };
        let groups = Groups::Workgroups(u64::from(pass::groups(width, height)));
        let prior: BufferSlice<'_> = self.priors.slice(place.first..place.first + place.bytes());
        let mask = compared.mask.map_or(prior, |(mask, _)| mask);
        let [image, aux, photograph, depth_map, parts, sums, grad_image, grad_aux] = vk::slices([
            &target.image,
            &target.aux,
            compared.photograph.buffer,
            &self.depth_map,
            &self.parts,
            &self.sums,
            compared.grad_image,
            &self.grad_aux,
        ]);
        let buffers = [image, aux, photograph, prior, mask, depth_map, parts];
        recorder.dispatch(pipeline, &buffers, &push, groups)?;
        let count = part_sum::Push { count: pass::parts(width, height), slot: 0 };
        recorder.dispatch(&self.sum, &[parts, sums], &count, Groups::Workgroups(1))?;
        let buffers = [image, aux, prior, depth_map, sums, grad_image, grad_aux, parts];
        recorder.dispatch(&self.grad, &buffers, &push, groups)?;
        Ok(&self.grad_aux)
    }

    /// Bytes per pixel of its buffers, and other bytes.
    pub(in crate::train) fn bytes(&self) -> [u64; 2] {
        [self.depth_map.size() + self.grad_aux.size() + self.parts.size(), self.priors.size() + self.sums.size()]
    }
}
