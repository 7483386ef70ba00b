//! Twin of `glsl/include/sh.glsl`: real spherical harmonics up to degree 3.

use super::Real;

const C0: f64 = 0.282_094_791_773_878_14;
const C1: f64 = 0.488_602_511_902_919_9;
const C2A: f64 = 1.092_548_430_592_079_2;
const C2B: f64 = 0.315_391_565_252_520_05;
const C2C: f64 = 0.546_274_215_296_039_6;
const C3A: f64 = 0.590_043_589_926_643_5;
const C3B: f64 = 2.890_611_442_640_554;
const C3C: f64 = 0.457_045_799_464_465_8;
const C3D: f64 = 0.373_176_332_590_115_4;
const C3E: f64 = 1.445_305_721_320_277;

/// Coefficients of a degree: (degree + 1)^2.
pub fn coefficients(degree: u32) -> usize {
    ((degree.min(3) + 1) * (degree.min(3) + 1)) as usize
}

/// The 16 basis values in a direction; zero above the degree.
pub fn basis<R: Real>([x, y, z]: [R; 3], degree: u32) -> [R; 16] {
    let c = |v: f64| R::of(v);
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let (two, three, four) = (c(2.0), c(3.0), c(4.0));
    let mut out = [
        c(C0),
        -c(C1) * y,
        c(C1) * z,
        -c(C1) * x,
        c(C2A) * x * y,
        -c(C2A) * y * z,
        c(C2B) * (two * zz - xx - yy),
        -c(C2A) * x * z,
        c(C2C) * (xx - yy),
        -c(C3A) * y * (three * xx - yy),
        c(C3B) * x * y * z,
        -c(C3C) * y * (four * zz - xx - yy),
        c(C3D) * z * (two * zz - three * xx - three * yy),
        -c(C3C) * x * (four * zz - xx - yy),
        c(C3E) * z * (xx - yy),
        -c(C3A) * x * (xx - three * yy),
    ];
    out[coefficients(degree)..].fill(R::zero());
    out
}

/// The gradient with respect to the direction of the sum of `s[k]` times basis function k.
pub fn slope<R: Real>([x, y, z]: [R; 3], degree: u32, s: &[R; 16]) -> [R; 3] {
    let c = |v: f64| R::of(v);
    let o = R::zero();
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let (two, three, four, six, eight) = (c(2.0), c(3.0), c(4.0), c(6.0), c(8.0));
    let table: [(f64, [R; 3]); 16] = [
        (C0, [o; 3]),
        (-C1, [o, R::one(), o]),
        (C1, [o, o, R::one()]),
        (-C1, [R::one(), o, o]),
        (C2A, [y, x, o]),
        (-C2A, [o, z, y]),
        (C2B, [-two * x, -two * y, four * z]),
        (-C2A, [z, o, x]),
        (C2C, [two * x, -two * y, o]),
        (-C3A, [six * x * y, three * (xx - yy), o]),
        (C3B, [y * z, x * z, x * y]),
        (-C3C, [-two * x * y, four * zz - xx - three * yy, eight * y * z]),
        (C3D, [-six * x * z, -six * y * z, six * zz - three * xx - three * yy]),
        (-C3C, [four * zz - three * xx - yy, -two * x * y, eight * x * z]),
        (C3E, [two * x * z, -two * y * z, xx - yy]),
        (-C3A, [three * (xx - yy), -six * x * y, o]),
    ];
    let mut out = [o; 3];
    for (k, (constant, d)) in table.iter().enumerate().take(coefficients(degree)) {
        for axis in 0..3 {
            out[axis] += c(*constant) * s[k] * d[axis];
        }
    }
    out
}
