//! Axes of the splats that begin on surfaces.

use glam::{DMat2, DVec2, DVec3};
use rayon::prelude::*;

use super::spacing::Chosen;
use crate::saliency::{self, Plane};
use crate::scene::Camera;
use crate::stereo::StereoView;
use crate::train::Error;

/// Narrowest width of a splat over its length.
const LEAST_RATIO: f64 = 1.0 / 3.0;
/// Squared coherence of the gradients of texture without a direction, in a window of two spacings: texture of natural
/// spectrum (amplitudes as the inverse frequency) has 0.06 to 0.1 by chance.
const CHANCE: f64 = 0.1;
/// Cosine of the angle between normal and ray from which on a view says nothing of texture on the surface: it shows too
/// little of the texture along the tilt.
const GRAZING: f64 = 0.25;

/// What the photograph says of the shape of a splat on a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    /// Unit direction on the surface along which the photograph varies least.
    pub(super) along: [f32; 3],
    /// Wavelength across that direction over the wavelength along it: from [`LEAST_RATIO`] to 1.
    pub(super) ratio: f64,
}

/// The shape of a splat at each of the points. Its ratio is that of the wavelengths on the surface: a wave's variation
/// is its squared amplitude over its squared wavelength, so the ratio is the root of that of the tensor's eigenvalues.
/// Splats of such a ratio lose as much along as across. The ratio is 1 where nothing varies, and where gradients agree no
/// more than by chance.
pub(super) fn shapes(views: &[StereoView], chosen: &[Chosen<'_>]) -> Result<Vec<Shape>, Error> {
    let mut of_views: Vec<Vec<usize>> = vec![Vec::new(); views.len()];
    for (i, of) in chosen.iter().enumerate() {
        if let Some(indices) = of_views.get_mut(of.point.first.0 as usize) {
            indices.push(i);
        }
    }
    let of_view = |(view, indices): (&StereoView, &Vec<usize>)| -> Result<Vec<(usize, Shape)>, Error> {
        let luma = Plane::new(view.camera.width, view.camera.height, view.luma.clone())?;
        let places: Vec<_> = indices.iter().map(|&i| (chosen[i].point.first.1 as usize, chosen[i].spacing)).collect();
        let tensors = saliency::variation(&luma, &places);
        Ok(indices.iter().zip(tensors).map(|(&i, tensor)| (i, shape(&view.camera, &chosen[i], tensor))).collect())
    };
    let found: Vec<_> = views.par_iter().zip(&of_views).map(of_view).collect::<Result<_, _>>()?;
    let mut shapes = vec![Shape { along: [1.0, 0.0, 0.0], ratio: 1.0 }; chosen.len()];
    found.into_iter().flatten().for_each(|(i, shape)| shapes[i] = shape);
    Ok(shapes)
}

fn shape(camera: &Camera, chosen: &Chosen<'_>, [xx, xy, yy]: [f64; 3]) -> Shape {
    let normal = DVec3::from_array(chosen.point.normal.map(f64::from));
    let first = normal.any_orthonormal_vector();
    let round = Shape { along: first.as_vec3().to_array(), ratio: 1.0 };
    let offset = DVec3::from_array(chosen.point.position) - DVec3::from_array(camera.center());
    let second = normal.cross(first);
    let Some(steps) = steps_of_a_pixel(camera, offset, normal) else {
        return round;
    };
    // Gradients on the surface, per scene unit, are those of the photograph times the inverse transpose of this.
    let pixels = DMat2::from_cols(
        DVec2::new(steps[0].dot(first), steps[0].dot(second)),
        DVec2::new(steps[1].dot(first), steps[1].dot(second)),
    );
    let pixel = pixels.determinant().abs().sqrt();
    let back = pixels.inverse();
    let tensor = back.transpose() * DMat2::from_cols(DVec2::new(xx, xy), DVec2::new(xy, yy)) * back;
    let floor = saliency::variation_floor(chosen.spacing) / (pixel * pixel);
    let [a, b, c] = [tensor.x_axis.x, 0.5 * (tensor.x_axis.y + tensor.y_axis.x), tensor.y_axis.y];
    let (mean, half) = (0.5 * (a + c), (0.25 * (a - c).powi(2) + b * b).sqrt());
    let coherence = half / (mean + floor);
    let coherence = ((coherence * coherence - CHANCE) / (1.0 - CHANCE)).clamp(0.0, 1.0).sqrt();
    if coherence.is_nan() || coherence == 0.0 {
        return round;
    }
    let ratio = ((1.0 - coherence) / (1.0 + coherence)).sqrt();
    // The direction of largest variation is at this angle, and that of the least across it.
    let angle = 0.5 * (2.0 * b).atan2(a - c);
    let along = second * angle.cos() - first * angle.sin();
    Shape { ratio: ratio.max(LEAST_RATIO), along: along.as_vec3().to_array() }
}

/// The steps on a surface from a pixel to the next along x and along y; `offset` is that of a point of the surface from
/// the camera's centre. `None` where the camera looks along the surface.
fn steps_of_a_pixel(camera: &Camera, offset: DVec3, normal: DVec3) -> Option<[DVec3; 2]> {
    let [right, down, forward] = camera.rotation.map(DVec3::from_array);
    let (depth, towards) = (offset.dot(forward), offset.dot(normal));
    let seen = depth > 0.0 && towards.abs() >= GRAZING * offset.length() * normal.length() && towards != 0.0;
    // The ray of the next pixel, up to where it meets the surface.
    let step = |aside: DVec3, focal: f64| (aside - offset * (aside.dot(normal) / towards)) * (depth / focal);
    seen.then(|| [step(right, camera.fx), step(down, camera.fy)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stereo::{FusedPoint, InitialPlanes};

    const SIZE: u32 = 96;

    /// A camera that looks at the origin from a distance of 2, turned about the y axis by an angle.
    fn camera(degrees: f64) -> Camera {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Camera {
            rotation: [[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]],
            translation: [0.0, 0.0, 2.0],
            fx: 192.0,
            fy: 192.0,
            cx: 48.0,
            cy: 48.0,
            width: SIZE,
            height: SIZE,
        }
    }

    /// The mean shape of splats around the middle of a picture of the plane z = 0 with a luma, and the mean direction,
    /// as cosine and sine of twice its angle from x towards y.
    fn seen(degrees: f64, luma: impl Fn(f64, f64) -> f64) -> (f64, [f64; 2]) {
        let camera = camera(degrees);
        let centre = DVec3::from_array(camera.center());
        let on_plane = |pixel: u32| {
            let [u, v] = [pixel % SIZE, pixel / SIZE].map(|k| f64::from(k) + 0.5);
            let ray = DVec3::from_array(camera.lifted([u, v], 1.0)) - centre;
            centre - ray * (centre.z / ray.z)
        };
        let view = StereoView {
            camera,
            luma: (0..SIZE * SIZE).map(|k| luma(on_plane(k).x, on_plane(k).y) as f32).collect(),
            colours: Vec::new(),
            sources: Vec::new(),
            depths: [1.0, 4.0],
            start: InitialPlanes::Random,
            wanted: None,
        };
        let pixels = (40..56_u32).flat_map(|y| (40..56_u32).map(move |x| y * SIZE + x));
        let point = |pixel: u32| FusedPoint {
            position: on_plane(pixel).to_array(),
            normal: [0.0, 0.0, -1.0],
            colour: [0; 3],
            pixels: 1,
            first: (0, pixel),
        };
        let points: Vec<FusedPoint> = pixels.map(point).collect();
        let chosen: Vec<Chosen<'_>> = points.iter().map(|point| Chosen { point, spacing: 2.0 }).collect();
        let all = shapes(&[view], &chosen).expect("shapes");
        let mean = |of: &dyn Fn(&Shape) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
        assert!(all.iter().all(|shape| shape.along[2].abs() < 1e-6), "on the surface");
        let doubled = |k: usize| {
            mean(&|shape: &Shape| {
                let [x, y] = [shape.along[0], shape.along[1]].map(f64::from);
                [x * x - y * y, 2.0 * x * y][k]
            })
        };
        (mean(&|s| s.ratio), [doubled(0), doubled(1)])
    }

    #[test]
    fn stripes_have_splats_along_them_from_every_side() {
        for (view, stripes) in [(0.0, 90.0), (0.0, 30.0), (50.0, 90.0), (50.0, 30.0), (-60.0, 120.0), (50.0, 0.0)] {
            let (sin, cos) = f64::to_radians(stripes).sin_cos();
            // Across stripes at an angle from the x axis, 12 pixels of a camera above them each.
            let wave = |x: f64, y: f64| 0.5 + 0.2 * ((x * sin - y * cos) * std::f64::consts::TAU / 0.125).sin();
            let (ratio, doubled) = seen(view, wave);
            let want = [f64::cos(2.0 * stripes.to_radians()), f64::sin(2.0 * stripes.to_radians())];
            let agree = doubled[0] * want[0] + doubled[1] * want[1];
            assert!(agree > 0.995, "stripes at {stripes} from {view}: {doubled:?}");
            assert!(ratio < 0.4, "stripes at {stripes} from {view}: {ratio}");
        }
    }

    #[test]
    fn flat_fields_and_checkerboards_have_round_splats() {
        let wave = |x: f64| (x * std::f64::consts::TAU / 0.125).sin();
        for view in [0.0, 40.0] {
            let (flat, _) = seen(view, |_, _| 0.5);
            assert!(flat > 0.999, "from {view}: {flat}");
            let (board, _) = seen(view, |x, y| 0.5 + 0.2 * wave(x) * wave(y));
            let (waves, _) = seen(view, |x, y| 0.5 + 0.1 * (wave(x) + wave(y)));
            assert!(board > 0.6 && waves > 0.6, "from {view}: {board} {waves}");
        }
        // A third as wide as long, along y; the blur by splats takes more of the shorter wave, and chance its part.
        let (longer, [doubled, _]) = seen(0.0, |x, y| 0.5 + 0.1 * (wave(x) + wave(y / 3.0)));
        assert!((0.33..0.5).contains(&longer) && doubled < -0.9, "{longer} {doubled}");
    }
}
