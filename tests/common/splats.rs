//! Random splats and a camera for tests of the projection and the renderer.
#![allow(dead_code, unreachable_pub)]

use psrgs_vk::scene::Camera;
use psrgs_vk::scene::random::Random;
use psrgs_vk::twin::splat::Splat;

/// A stream of random numbers for each seed, which begins far from the streams of other seeds.
pub fn seeded(seed: u64) -> Random {
    Random::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x1234_5678)
}

/// Three numbers in [-1, 1).
pub fn vector(random: &mut Random) -> [f64; 3] {
    std::array::from_fn(|_| random.symmetric())
}

/// A turned and displaced camera with unequal focal lengths and a principal point off the middle.
pub fn camera(width: u32, height: u32) -> Camera {
    let (a, b) = (0.3f64, -0.2f64);
    let (sa, ca, sb, cb) = (a.sin(), a.cos(), b.sin(), b.cos());
    let (w, h) = (f64::from(width), f64::from(height));
    Camera {
        rotation: [[ca, 0.0, sa], [sa * sb, cb, -ca * sb], [-sa * cb, sb, ca * cb]],
        translation: [0.2, -0.4, 1.5],
        fx: 0.8 * w,
        fy: 0.9 * w,
        cx: 0.47 * w,
        cy: 0.55 * h,
        width,
        height,
    }
}

/// The scene position of a point given in the camera frame.
pub fn to_scene(camera: &Camera, p: [f64; 3]) -> [f64; 3] {
    let r = &camera.rotation;
    let d: [f64; 3] = std::array::from_fn(|k| p[k] - camera.translation[k]);
    std::array::from_fn(|i| r[0][i] * d[0] + r[1][i] * d[1] + r[2][i] * d[2])
}

/// A splat whose centre lies anywhere within `reach` times the half image from its middle.
pub fn spread(random: &mut Random, camera: &Camera, reach: f64) -> Splat<f64> {
    let z = random.range(1.0, 5.0);
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let (u, v) = (w * (0.5 + 0.5 * reach * random.symmetric()), h * (0.5 + 0.5 * reach * random.symmetric()));
    let p = [(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z];
    let size = random.range(-3.0, -1.0);
    Splat {
        mean: to_scene(camera, p),
        quat: std::array::from_fn(|_| 1.5 * random.symmetric()),
        log_scale: std::array::from_fn(|_| size + 0.9 * random.symmetric()),
        logit: random.range(-1.5, 2.0),
        sh: std::array::from_fn(|k| vector(random).map(|v| v * if k == 0 { 1.5 } else { 0.25 })),
    }
}

/// A splat well inside the image and large enough to be seen there.
pub fn in_view(random: &mut Random, camera: &Camera) -> Splat<f64> {
    let mut splat = spread(random, camera, 0.6);
    splat.log_scale = std::array::from_fn(|_| random.range(-1.6, -0.6));
    splat.sh[0] = splat.sh[0].map(|v| 1.0 + 0.5 * v);
    splat
}

/// The camera as the device gets it.
pub fn rounded(camera: Camera) -> Camera {
    let f = |v: f64| f64::from(v as f32);
    Camera {
        rotation: camera.rotation.map(|row| row.map(f)),
        translation: camera.translation.map(f),
        fx: f(camera.fx),
        fy: f(camera.fy),
        cx: f(camera.cx),
        cy: f(camera.cy),
        ..camera
    }
}

/// A small model with cameras around it, as the page of a report.
#[cfg(feature = "html-viewer")]
pub fn page(title: &str) -> psrgs_vk::eval::Interactive {
    let (mut random, mut model) = (seeded(3), psrgs_vk::scene::Gaussians::zeros(200));
    for row in 0..model.len() {
        model.opacities[row] = 2.0;
        for k in 0..3 {
            model.means[3 * row + k] = random.symmetric() as f32;
            model.scales[3 * row + k] = -2.0;
            model.sh[0][12 * row + k] = random.symmetric() as f32;
        }
        model.quats[4 * row] = 1.0;
    }
    let look = camera(320, 240);
    let back = [(title.to_owned(), Camera { translation: [0.0, 0.0, 4.0], ..look })];
    let html = psrgs_vk::format::html::Shown {
        title,
        gaussians: &model,
        cameras: &back,
        up: None,
        sh_degree: 0,
        background: [0.0; 3],
        antialias: false,
    };
    psrgs_vk::eval::Interactive::page(&html.html().expect("a page")).expect("a small page")
}
