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
    let (reply, size) = match &wanted.ask {
        Ask::Frame(ask) => {
            let size = pacer.size(scene.within(ask.size), ask.moving);
            match ask.pose.camera(scene, size) {
                Some(camera) => (model.draw(&camera, ask.look()).map(Reply::Frame), (camera.width, camera.height)),
                None => (Err("there is no such photograph".to_owned()), size),
            }
        }
        Ask::Pick(ask) => {
            let size = scene.within(ask.size);
            let camera = ask.pose.camera(scene, size);
            let depths = camera.map(|camera| model.depths(&camera).map(|z| Reply::Point(ask.point(&camera, &z))));
            (depths.unwrap_or_else(|| Err("there is no such photograph".to_owned())), size)
        }
    };
    pacer.drew(size, begun.elapsed().as_secs_f64());
    board.drew();
    wanted.answer(reply.unwrap_or_else(Reply::Failed));
}
