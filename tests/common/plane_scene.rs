//! A tiny scene in memory: a textured ground plane z = 0 photographed from a ring of oblique cameras.

use psrgs_vk::dataset::Pixels;
use psrgs_vk::scene::{Camera, Gaussians};
use psrgs_vk::train::{Input, OptionalInput, View};

/// Colour of the ground at (x, y), smooth waves and a checkerboard, in 0..1.
fn ground(x: f64, y: f64) -> [f64; 3] {
    let checker = if ((x * 2.0).floor() + (y * 2.0).floor()).rem_euclid(2.0) < 0.5 { 0.25 } else { -0.25 };
    [0.5 + 0.2 * (1.3 * x).sin() + checker, 0.5 + 0.2 * (1.7 * y).cos() + 0.5 * checker, 0.45 + 0.1 * (x + y).sin()]
}

fn look_at(eye: [f64; 3], width: u32, height: u32) -> Camera {
    let norm = |v: [f64; 3]| {
        let l = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        [v[0] / l, v[1] / l, v[2] / l]
    };
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let forward = norm([-eye[0], -eye[1], -eye[2]]);
    let right = norm(cross(forward, [0.0, 0.0, 1.0]));
    let down = cross(forward, right);
    let rotation = [right, down, forward];
    let translation = std::array::from_fn(|i| -(0..3).map(|j| rotation[i][j] * eye[j]).sum::<f64>());
    let f = f64::from(width) * 1.1;
    Camera {
        rotation,
        translation,
        fx: f,
        fy: f,
        cx: f64::from(width) * 0.48,
        cy: f64::from(height) * 0.53,
        width,
        height,
    }
}

fn photograph(camera: &Camera) -> Vec<u8> {
    let eye = camera.center();
    let r = &camera.rotation;
    let mut rgba = Vec::with_capacity((camera.width * camera.height * 4) as usize);
    for j in 0..camera.height {
        for i in 0..camera.width {
            let d = [(f64::from(i) + 0.5 - camera.cx) / camera.fx, (f64::from(j) + 0.5 - camera.cy) / camera.fy, 1.0];
            let w: [f64; 3] = std::array::from_fn(|k| r[0][k] * d[0] + r[1][k] * d[1] + r[2][k] * d[2]);
            let t = -eye[2] / w[2];
            let (x, y) = (eye[0] + t * w[0], eye[1] + t * w[1]);
            let inside = t > 0.0 && x.abs() < 3.0 && y.abs() < 3.0;
            let c = if inside { ground(x, y) } else { [0.0; 3] };
            rgba.extend(c.map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8));
            rgba.push(255);
        }
    }
    rgba
}

fn hash(mut x: u32) -> f64 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^= x >> 16;
    f64::from(x) / f64::from(u32::MAX)
}

/// Grey splats scattered over the ground, with opacity 0.1 and the size of their spacing.
pub fn splats(n: usize) -> Gaussians {
    let mut g = Gaussians::zeros(n);
    let size = (6.0 / (n as f64).sqrt() * 0.5).max(1e-3).ln() as f32;
    for i in 0..n {
        let k = i as u32 * 3;
        g.means[3 * i] = (6.0 * hash(k) - 3.0) as f32;
        g.means[3 * i + 1] = (6.0 * hash(k + 1) - 3.0) as f32;
        g.means[3 * i + 2] = (0.02 * hash(k + 2)) as f32;
        g.quats[4 * i] = 1.0;
        g.scales[3 * i..3 * i + 3].fill(size);
        g.opacities[i] = -2.197_224_6;
        for c in 0..3 {
            g.sh[0][12 * i + c] = (0.3 * (hash(k + 7919 * c as u32) - 0.5)) as f32;
        }
    }
    g
}

/// `views` training views and two held-out ones of `width` x `height`, `n` splats to begin with.
pub fn input(views: usize, width: u32, height: u32, n: usize) -> Input {
    let view = |name: String, angle: f64, up: f64| {
        let camera = look_at([4.2 * angle.cos(), 4.2 * angle.sin(), up], width, height);
        View::new(&name, camera, Pixels::Rgba8(photograph(&camera)))
    };
    let ring = |i: usize, of: usize| std::f64::consts::TAU * i as f64 / of as f64;
    Input {
        train: (0..views).map(|i| view(format!("train{i}"), ring(i, views), 2.5 + 0.3 * (i % 3) as f64)).collect(),
        held_out: (0..2).map(|i| view(format!("test{i}"), ring(2 * i + 1, 2 * views), 2.7)).collect(),
        initial: splats(n),
        extent: 5.0,
        optional: OptionalInput::default(),
    }
}
