//! The page of a model with its photographs' cameras.

use super::{FROM_VIEWER, Page};
use crate::format::ply::Model;
use crate::format::splats::{EncodeError, sog};
use crate::scene::viewpoints::{Viewpoint, viewpoints};
use crate::scene::{Camera, Gaussians, Similarity, turn, up_of};

/// Most places to look from.
const VIEWS: usize = 8;
/// Up without cameras: that of most models, whose axes are those of a first photograph.
const UP: [f64; 3] = [0.0, -1.0, 0.0];

/// A model with the cameras of its photographs, in the same coordinates.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// Title of the page.
    pub title: &'a str,
    /// The splats.
    pub gaussians: &'a Gaussians,
    /// Names and cameras of the photographs; none are needed.
    pub cameras: &'a [(String, Camera)],
    /// Which way is up; `None` takes what the cameras tell.
    pub up: Option<[f64; 3]>,
    /// Degree of spherical harmonics in the page.
    pub sh_degree: u32,
    /// Colour behind the model, 0 to 1.
    pub background: [f32; 3],
    /// Whether opacities carry the anti-aliasing factor.
    pub antialias: bool,
}

impl Shown<'_> {
    fn direction_up(&self) -> [f64; 3] {
        let cameras: Vec<Camera> = self.cameras.iter().map(|(_, camera)| *camera).collect();
        self.up.or_else(|| up_of(&cameras)).unwrap_or(UP)
    }

    fn upright(&self) -> Similarity {
        Similarity { rotation: turn(self.direction_up(), [0.0, 1.0, 0.0]), ..Similarity::IDENTITY }
    }

    /// From the coordinates of `gaussians` to those of the model within the page, which is a SOG file.
    pub fn to_file(&self) -> Similarity {
        self.upright().then(&Similarity { rotation: FROM_VIEWER, ..Similarity::IDENTITY })
    }

    /// The page: the model upright, looked at from the camera that sees most of it.
    pub fn html(&self) -> Result<String, EncodeError> {
        let (up, upright) = (self.direction_up(), self.upright());
        let turned = |view: Viewpoint| Viewpoint {
            position: upright.point(view.position),
            target: upright.point(view.target),
            ..view
        };
        let length = up.iter().map(|v| v * v).sum::<f64>().sqrt();
        let unit = up.map(|v| v / length);
        let views = viewpoints(self.gaussians, self.cameras, unit, VIEWS);
        let views: Vec<Viewpoint> = views.into_iter().map(turned).collect();
        let model = Model {
            gaussians: self.to_file().gaussians(self.gaussians),
            sh_degree: self.sh_degree,
            antialias: Some(self.antialias),
            ..Model::default()
        };
        let sog = sog::encode(&model, self.sh_degree)?;
        let Self { title, background, antialias, .. } = *self;
        Ok(Page { title, sog: &sog, views: &views, background, antialias }.html())
    }
}
