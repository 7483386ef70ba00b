//! Views larger than their photographs.

use image::RgbaImage;
use image::imageops::{FilterType, resize};

use crate::dataset::{self, Pixels};
use crate::train::View;

/// Enlarges a view whose longer side is shorter than `side` pixels, linearly between pixels. The view shows no new
/// detail, but every pass has the work of a photograph of that size.
pub(super) fn enlarge(view: &mut View, side: u32) -> Result<(), dataset::Error> {
    let (width, height) = (view.camera.width, view.camera.height);
    let longer = width.max(height);
    if longer == 0 || side <= longer {
        return Ok(());
    }
    let scaled = |x: u32| ((u64::from(x) * u64::from(side) + u64::from(longer) / 2) / u64::from(longer)).max(1) as u32;
    let rgba = view.photograph.pixels()?.rgba8().into_owned();
    let Some(photograph) = RgbaImage::from_raw(width, height, rgba) else { return Ok(()) };
    let camera = view.camera.resized(scaled(width), scaled(height));
    let large = resize(&photograph, camera.width, camera.height, FilterType::Triangle).into_raw();
    *view = View::new(&view.name, camera, Pixels::Rgba8(large));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::enlarge;
    use crate::dataset::Pixels;
    use crate::scene::Camera;
    use crate::train::View;

    #[test]
    fn pixels_and_camera_grow_together() {
        let rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let camera =
            Camera { rotation, translation: [0.0; 3], fx: 30.0, fy: 32.0, cx: 4.0, cy: 2.0, width: 8, height: 4 };
        let rgba: Vec<u8> = (0..4 * 8 * 4).map(|i| if i % 4 == 3 { 255 } else { 90 }).collect();
        let view = View::new("a", camera, Pixels::Rgba8(rgba.clone()));
        let rgba_of = |view: &View| view.photograph.pixels().unwrap().rgba8().into_owned();
        let mut same = view.clone();
        enlarge(&mut same, 8).unwrap();
        assert_eq!((same.camera, rgba_of(&same)), (camera, rgba));
        let mut large = view;
        enlarge(&mut large, 20).unwrap();
        let c = large.camera;
        assert_eq!((c.width, c.height, c.fx, c.fy, c.cx, c.cy), (20, 10, 75.0, 80.0, 10.0, 5.0));
        assert_eq!(rgba_of(&large).len(), 4 * 20 * 10);
        assert!(rgba_of(&large).chunks(4).all(|p| p == [90, 90, 90, 255]));
    }
}
