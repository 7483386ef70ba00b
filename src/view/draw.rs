//! Answers of whoever has the model on a device.

use std::time::Instant;

use super::ask::Ask;
use super::board::{Board, Reply, Wanted};
use super::pacer::Pacer;
use super::scene_info::SceneInfo;
use crate::raster::{Look, Picture};
use crate::scene::Camera;

/// A model on a device.
pub trait Drawable {
    /// Waits until the device has done what was submitted, so that the time of a picture is the picture's own.
    fn settle(&mut self) -> Result<(), String>;

    /// Draws the model from a camera.
    fn draw(&mut self, camera: &Camera, look: Look) -> Result<Picture, String>;

    /// Median depths at the pixels of a camera, row-major, in scene units; 0 where there is no surface.
    fn depths(&mut self, camera: &Camera) -> Result<Vec<f32>, String>;
}

/// Draws or measures what is wanted and answers. The pacer chooses the size and is told the time.
pub fn answer(wanted: Wanted, scene: &SceneInfo, board: &Board, pacer: &mut Pacer, model: &mut dyn Drawable) {
    if let Err(why) = model.settle() {
        return wanted.answer(Reply::Failed(why));
    }
    let begun = Instant::now();
    let (reply, camera) = match &wanted.ask {
        Ask::Frame(ask) => {
            let camera = ask.pose.camera(scene, ask.size).and_then(|whole| {
                let size = pacer.size((whole.width, whole.height), ask.moving);
                ask.pose.camera(scene, size)
            });
            let drawn = camera.map(|camera| model.draw(&camera, ask.look()).map(Reply::Frame));
            (drawn, camera)
        }
        Ask::Pick(ask) => {
            let camera = ask.pose.camera(scene, ask.size).and_then(|whole| {
                let size = pacer.size((whole.width, whole.height), false);
                ask.pose.camera(scene, size)
            });
            let point = camera.map(|camera| model.depths(&camera).map(|z| Reply::Point(ask.point(&camera, &z))));
            (point, camera)
        }
    };
    if let Some(camera) = camera {
        pacer.drew((camera.width, camera.height), begun.elapsed().as_secs_f64());
        board.drew();
    }
    let reply = reply.unwrap_or_else(|| Err("there is no such photograph".to_owned()));
    wanted.answer(reply.unwrap_or_else(Reply::Failed));
}
