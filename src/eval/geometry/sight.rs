//! What training photographs see of the true surface, and how finely.

use rayon::prelude::*;

use super::pictures::median;
use super::truth::{GeometryError, GeometryTruth, Known, Maps, Witness};

/// A point is hidden from a photograph where its depth is more than this many times the true depth of its pixel.
const HIDDEN: f64 = 1.01;

/// So many training photographs must see a point.
const WITNESSES: u8 = 2;

/// Pixels whose depths are held at once.
const AT_ONCE: usize = 1 << 24;

/// For each map its pixels: whether two or more training photographs see the true surface there.
pub(super) fn seen(truth: &GeometryTruth, maps: &[&Maps]) -> Result<Vec<Vec<bool>>, GeometryError> {
    let mut out: Vec<Vec<bool>> = Vec::with_capacity(maps.len());
    while out.len() < maps.len() {
        let (mut batch, mut pixels) = (Vec::new(), 0);
        for maps in &maps[out.len()..] {
            if pixels >= AT_ONCE {
                break;
            }
            let known = maps.read_depth()?;
            pixels += known.depth.len();
            batch.push(known);
        }
        out.extend(seen_of(truth, &batch)?);
    }
    Ok(out)
}

fn seen_of(truth: &GeometryTruth, batch: &[Known]) -> Result<Vec<Vec<bool>>, GeometryError> {
    let scale = truth.frame.scale;
    let mut counts: Vec<Vec<u8>> = batch.iter().map(|known| vec![0; known.depth.len()]).collect();
    for witness in &truth.witnesses {
        let map = witness.maps.as_ref().map(Maps::read_depth).transpose()?;
        for (known, counts) in batch.iter().zip(&mut counts) {
            let open = counts.par_iter_mut().enumerate().filter(|(_, count)| **count < WITNESSES);
            open.for_each(|(pixel, count)| {
                let point = known.point(pixel, scale);
                *count += u8::from(point.is_some_and(|point| sees(witness, map.as_ref(), point, scale)));
            });
        }
    }
    let enough = |counts: Vec<u8>| counts.into_iter().map(|count| count >= WITNESSES).collect();
    Ok(counts.into_iter().map(enough).collect())
}

/// Whether a photograph sees a point of the true surface: the point is in the picture, and not hidden by what the
/// photograph's own true depth has there, where that is known.
fn sees(witness: &Witness, map: Option<&Known>, point: [f64; 3], scale: f64) -> bool {
    let camera = map.map_or(&witness.camera, |map| &map.camera);
    let Some([u, v, depth]) = camera.placed(point) else { return false };
    let at = v as usize * camera.width as usize + u as usize;
    let before = map.and_then(|map| map.depth.get(at)).map(|z| f64::from(*z) * scale);
    before.is_none_or(|before| !(before > 0.0 && before.is_finite()) || depth <= HIDDEN * before)
}

/// The ground sample distance in the dataset's units: the distance between the places that neighbouring pixels show,
/// the median true depth over the focal length, at the maps' size. The mean over the training photographs with a map.
pub(super) fn ground_sample(truth: &GeometryTruth) -> Result<Option<f64>, GeometryError> {
    let mut samples = Vec::new();
    for maps in truth.witnesses.iter().filter_map(|witness| witness.maps.as_ref()) {
        let Known { camera, depth, .. } = maps.read_depth()?;
        let known: Vec<f32> = depth.into_iter().filter(|z| *z > 0.0 && z.is_finite()).collect();
        samples.extend(median(&known).map(|depth| depth / camera.fx));
    }
    Ok(crate::numbers::mean(samples.into_iter()))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::dataset::DecodeLimit;
    use crate::format::image_out::write_depth;
    use crate::scene::{Camera, Frame};

    /// Looks along z from a place on the x axis, over pixels that are a unit wide at a depth of 10.
    fn camera(x: f64, width: u32) -> Camera {
        let rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let translation = [-x, 0.0, 0.0];
        Camera { rotation, translation, fx: 10.0, fy: 10.0, cx: f64::from(width) / 2.0, cy: 0.5, width, height: 1 }
    }

    fn maps(folder: &Path, name: &str, camera: Camera, depths: &[f32]) -> Maps {
        let file = folder.join(name);
        write_depth(&file, depths.len() as u32, 1, depths).expect("written");
        Maps::of_depth(camera, file, DecodeLimit::new(None))
    }

    /// A wall of six pixels at a depth of 20 in a dataset of half the scene's scale, looked at by three photographs:
    /// one without a map of its four pixels in the middle; one of all, in which something nearer hides the fourth and
    /// the wall's own roughness does not hide the fifth; one that sees the first and the last.
    #[test]
    fn two_photographs_see_what_is_inside_and_not_hidden() {
        let dir = tempfile::tempdir().expect("a folder");
        let of = |name: &str, camera: Camera, depths: &[f32]| maps(dir.path(), name, camera, depths);
        let wall = of("wall.exr", camera(0.0, 6), &[20.0, 20.0, 20.0, 20.0, 20.0, 0.0]);
        let rough = [20.0, 20.0, 20.0, 10.0, 19.9, 20.0];
        let with_map = |maps: Maps| Witness { camera: camera(0.0, 6), maps: Some(maps) };
        let truth = GeometryTruth {
            frame: Frame { offset: [0.0; 3], scale: 0.5 },
            extent: 1.0,
            views: Vec::new(),
            offpath: Vec::new(),
            surface: None,
            witnesses: vec![
                Witness { camera: camera(0.0, 4), maps: None },
                with_map(of("rough.exr", camera(0.0, 6), &rough)),
                with_map(of("rim.exr", camera(0.0, 6), &[20.0, 1.0, 1.0, 1.0, 1.0, 20.0])),
            ],
        };
        let seen = seen(&truth, &[&wall, &wall]).expect("read");
        assert_eq!(seen, vec![vec![true, true, true, false, true, false]; 2]);
        // Medians of 20, 20 and 1 (of even counts the upper value), over a focal length of 10 pixels.
        let sample = ground_sample(&truth).expect("read").expect("two maps");
        assert!((sample - (2.0 + 0.1) / 2.0).abs() < 1e-12, "{sample}");
    }
}
