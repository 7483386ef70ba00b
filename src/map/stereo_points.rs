//! Stereo's points on a map.

use crate::format::las::CloudPoint;
use crate::geodesy::Georeference;
use crate::scene::{Frame, Similarity};
use crate::stereo::{FusedPoint, StereoView};

/// Expected error in pixels of a match.
const MATCH_ERROR: f64 = 0.3;

/// The fused cloud of stereo as points of a map.
#[derive(Clone, Copy, Debug)]
pub struct StereoPoints<'a> {
    /// The points, in scene coordinates.
    pub points: &'a [FusedPoint],
    /// The views, in scene coordinates.
    pub views: &'a [StereoView],
    /// Scene and dataset.
    pub frame: &'a Frame,
    /// From the dataset to the map.
    pub georeference: &'a Georeference,
}

impl StereoPoints<'_> {
    /// The points. The error of a point is that of its depth in the view that shows the point first: what a third of a
    /// pixel amounts to with the longest base among the view's sources.
    pub fn points(&self) -> impl Iterator<Item = CloudPoint> + '_ {
        let to_dataset = Similarity::to_scene(self.frame).inverse();
        let to_map = self.georeference.similarity_at(self.frame.to_dataset([0.0; 3]));
        let turned = to_dataset.then(&to_map);
        self.points.iter().map(move |point| {
            let normal = point.normal.map(f64::from);
            CloudPoint {
                position: self.georeference.to_map(self.frame.to_dataset(point.position)),
                colour: point.colour,
                normal: turned.rotation.map(|row| (0..3).map(|k| row[k] * normal[k]).sum::<f64>() as f32),
                error: (turned.scale * self.error(point)) as f32,
            }
        })
    }

    /// Expected error of a point's depth, scene units; 0 where it is not known.
    fn error(&self, point: &FusedPoint) -> f64 {
        let Some(view) = self.views.get(point.first.0 as usize) else { return 0.0 };
        let (eye, at) = (view.camera.center(), point.position);
        let ray: [f64; 3] = std::array::from_fn(|k| at[k] - eye[k]);
        let far = ray.iter().map(|v| v * v).sum::<f64>().sqrt();
        let base = |source: &usize| {
            let other = self.views[*source].camera.center();
            let step: [f64; 3] = std::array::from_fn(|k| other[k] - eye[k]);
            let along = (0..3).map(|k| step[k] * ray[k]).sum::<f64>() / far.max(1e-12);
            (step.iter().map(|v| v * v).sum::<f64>() - along * along).max(0.0).sqrt()
        };
        let longest = view.sources.iter().filter(|s| **s < self.views.len()).map(base).fold(0.0, f64::max);
        if longest > 0.0 { MATCH_ERROR * far * far / (view.camera.fx * longest) } else { 0.0 }
    }
}
