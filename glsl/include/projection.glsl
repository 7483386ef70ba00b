// EWA projection of a 3D Gaussian (Zwicker et al. 2001; Kerbl et al. 2023) and its derivative, in product form: the 2D
// covariance is M M^T with M = J W R S (2x3, rows m0 and m1), so its determinant is |m0 x m1|^2, a sum of squares, and
// no products of covariances are subtracted: needles keep their thin axis in f32.
#ifndef PROJECTION_GLSL
#define PROJECTION_GLSL
#include "camera.glsl"
#include "finite.glsl"

const float DILATION = 0.3;               // px^2 added to both diagonals
const float ANTIALIAS_FLOOR = 2.5e-5;     // smallest det ratio (Mip-Splatting)
const float QUAT_MIN_SQUARED = 1e-24;     // a shorter quaternion counts as the identity, without gradient

struct Rotation {
    vec3 r0, r1, r2;  // rows
    vec4 unit;        // the unit quaternion, w first
    float inverse;    // 1 / length of the quaternion; 0 if it counts as the identity
};

Rotation rotation_of(vec4 quat) {
    const float squared = dot(quat, quat);
    const bool usable = squared >= QUAT_MIN_SQUARED;
    const float inverse = usable ? 1.0 / sqrt(squared) : 0.0;
    const vec4 q = usable ? quat * inverse : vec4(1.0, 0.0, 0.0, 0.0);
    const float w = q.x, x = q.y, y = q.z, z = q.w;
    return Rotation(vec3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
                    vec3(2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
                    vec3(2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)), q, inverse);
}

// dL/d(quat) from dL/dR by rows.
vec4 rotation_backward(Rotation rot, vec3 g0, vec3 g1, vec3 g2) {
    const float w = rot.unit.x, x = rot.unit.y, y = rot.unit.z, z = rot.unit.w;
    const vec4 g = 2.0 * vec4(z * (g1.x - g0.y) + y * (g0.z - g2.x) + x * (g2.y - g1.z),
                              y * (g0.y + g1.x) + z * (g0.z + g2.x) - 2.0 * x * (g1.y + g2.z) + w * (g2.y - g1.z),
                              x * (g0.y + g1.x) + z * (g1.z + g2.y) - 2.0 * y * (g0.x + g2.z) + w * (g0.z - g2.x),
                              x * (g0.z + g2.x) + y * (g1.z + g2.y) - 2.0 * z * (g0.x + g1.y) + w * (g1.x - g0.y));
    return (g - rot.unit * dot(rot.unit, g)) * rot.inverse;
}

vec3 to_camera(Camera camera, vec3 mean) {
    return vec3(dot(camera.w0, mean), dot(camera.w1, mean), dot(camera.w2, mean)) + camera.t;
}

// Sigmoid and its slope, without overflow at either end.
vec2 sigmoid(float x) {
    const float e = exp(-abs(x));
    const float d = 1.0 / (1.0 + e);
    return vec2(x >= 0.0 ? d : e * d, e * d * d);
}

struct Ewa {
    Rotation rot;
    vec3 scale;       // standard deviations
    vec3 u0, u1, u2;  // rows of W R S
    vec2 ratio;       // x/z and y/z after the clamp to the field of view
    bvec2 clamped;
    vec2 zoom;        // focal / z
    vec3 m0, m1;      // rows of J W R S, pixels
    vec3 n;           // m0 x m1
    float det0;       // determinant before the dilation
    float det;        // determinant after the dilation
    vec3 conic;
    float rest;       // C - B^2 / A, which is 1 / (dilated variance along y)
    float compensation;  // sqrt(det0 / det), floored
    bool floored;
};

Ewa ewa_project(Camera camera, vec3 p, vec4 quat, vec3 log_scale) {
    Ewa e;
    e.rot = rotation_of(quat);
    e.scale = exp(log_scale);
    e.u0 = (camera.w0.x * e.rot.r0 + camera.w0.y * e.rot.r1 + camera.w0.z * e.rot.r2) * e.scale;
    e.u1 = (camera.w1.x * e.rot.r0 + camera.w1.y * e.rot.r1 + camera.w1.z * e.rot.r2) * e.scale;
    e.u2 = (camera.w2.x * e.rot.r0 + camera.w2.y * e.rot.r1 + camera.w2.z * e.rot.r2) * e.scale;
    const vec2 free = p.xy / p.z;
    e.ratio = clamp(free, camera.limits.xz, camera.limits.yw);
    e.clamped = notEqual(free, e.ratio);
    e.zoom = camera.focal / p.z;
    e.m0 = e.zoom.x * (e.u0 - e.ratio.x * e.u2);
    e.m1 = e.zoom.y * (e.u1 - e.ratio.y * e.u2);
    e.n = cross(e.m0, e.m1);
    const float a = dot(e.m0, e.m0), c = dot(e.m1, e.m1);
    e.det0 = dot(e.n, e.n);
    e.det = e.det0 + DILATION * (a + c) + DILATION * DILATION;
    e.rest = 1.0 / (c + DILATION);
    e.conic = vec3(c + DILATION, -dot(e.m0, e.m1), a + DILATION) / e.det;
    const float share = e.det0 / e.det;
    e.floored = share <= ANTIALIAS_FLOOR;
    e.compensation = sqrt(max(ANTIALIAS_FLOOR, share));
    return e;
}

// Change of the depth per pixel: the mean of z under the Gaussian at a pixel is the depth of the centre plus the slope
// times the pixel's distance. With Q the conic's matrix, the slope is Q M u2.
vec2 depth_slope(Ewa e) {
    const vec3 k0 = DILATION * e.m0 + cross(e.m1, e.n), k1 = DILATION * e.m1 + cross(e.n, e.m0);
    return vec2(dot(k0, e.u2), dot(k1, e.u2)) / e.det;
}

struct EwaGrad {
    vec3 p;          // camera-frame centre
    vec4 quat;
    vec3 log_scale;
};

// g_conic: dL/d(A, B, C). g_compensation: dL/d(compensation), 0 without anti-aliasing.
// g_axis: dL/d(column `axis` of R), 0 without normals. reference_clamp: see VIEW_REFERENCE_CLAMP.
EwaGrad ewa_backward(Camera camera, Ewa e, float z, vec3 g_conic, float g_compensation, vec3 g_axis, uint axis,
                     bool reference_clamp) {
    // d(conic) = -Q dSigma Q and Sigma = M M^T, so dL/dM = -2 Q G (Q M); Q M in product form, see the head of the file.
    const vec3 x0 = cross(e.m1, e.n), x1 = cross(e.n, e.m0);
    const vec3 k0 = (DILATION * e.m0 + x0) / e.det;
    const vec3 k1 = (DILATION * e.m1 + x1) / e.det;
    const vec3 h0 = g_conic.x * k0 + 0.5 * g_conic.y * k1;
    const vec3 h1 = 0.5 * g_conic.y * k0 + g_conic.z * k1;
    vec3 gm0 = -2.0 * (e.conic.x * h0 + e.conic.y * h1);
    vec3 gm1 = -2.0 * (e.conic.y * h0 + e.conic.z * h1);
    // A scale stretches its column of M, so dL/d(log scale) is m0 gm0 + m1 gm1 of that column: -2 (Q M)^T G (Q M). This
    // form is accurate because the elements of Q M are small along a needle; the elements of M are large there, and
    // their products with gm cancel.
    EwaGrad g;
    g.log_scale = -2.0 * (h0 * k0 + h1 * k1);
    if (!e.floored) {
        const float up = g_compensation / (e.compensation * e.det), down = g_compensation * e.compensation;
        gm0 += up * x0 - down * k0;
        gm1 += up * x1 - down * k1;
        // m0 x0 + m1 x1 of a column: the squares of the two elements of n that the column is part of.
        const vec3 squares = e.n * e.n;
        const vec3 stretched = squares.yzx + squares.zxy;
        g.log_scale += up * stretched - down * ((DILATION * (e.m0 * e.m0 + e.m1 * e.m1) + stretched) / e.det);
    }

    // M = J W R S; row 0 of J is zoom.x (1, 0, -ratio.x), row 1 is zoom.y (0, 1, -ratio.y).
    const vec3 gu0 = e.zoom.x * gm0, gu1 = e.zoom.y * gm1;
    const vec3 gu2 = -(e.ratio.x * gu0 + e.ratio.y * gu1);
    const vec2 g_ratio = -vec2(dot(gu0, e.u2), dot(gu1, e.u2));
    // A nearer splat is larger: dL/d(zoom) * zoom, summed over both axes.
    const float g_zoom_zoom = g.log_scale.x + g.log_scale.y + g.log_scale.z;
    const bvec2 still = bvec2(e.clamped.x && !reference_clamp, e.clamped.y && !reference_clamp);
    g.p.x = e.clamped.x ? 0.0 : g_ratio.x / z;
    g.p.y = e.clamped.y ? 0.0 : g_ratio.y / z;
    g.p.z = -(g_zoom_zoom + (still.x ? 0.0 : g_ratio.x * e.ratio.x) +
              (still.y ? 0.0 : g_ratio.y * e.ratio.y)) / z;

    // V = R S, dL/dV = W^T dL/dU, by rows.
    const vec3 gv0 = camera.w0.x * gu0 + camera.w1.x * gu1 + camera.w2.x * gu2;
    const vec3 gv1 = camera.w0.y * gu0 + camera.w1.y * gu1 + camera.w2.y * gu2;
    const vec3 gv2 = camera.w0.z * gu0 + camera.w1.z * gu1 + camera.w2.z * gu2;
    const vec3 chosen = vec3(axis == 0u, axis == 1u, axis == 2u);
    g.quat = rotation_backward(e.rot, gv0 * e.scale + g_axis.x * chosen, gv1 * e.scale + g_axis.y * chosen,
                               gv2 * e.scale + g_axis.z * chosen);
    return g;
}

// The axis with the smallest scale, the first of equals.
uint shortest_axis(vec3 log_scale) {
    const uint xy = log_scale.y < log_scale.x ? 1u : 0u;
    return log_scale.z < min(log_scale.x, log_scale.y) ? 2u : xy;
}

vec3 rotation_column(Rotation rot, uint axis) {
    const vec3 chosen = vec3(axis == 0u, axis == 1u, axis == 2u);
    return vec3(dot(rot.r0, chosen), dot(rot.r1, chosen), dot(rot.r2, chosen));
}

// Camera-frame normal: the shortest axis, turned towards the camera.
vec3 splat_normal(Camera camera, vec3 p, Rotation rot, uint axis, out float side) {
    const vec3 column = rotation_column(rot, axis);
    const vec3 n = vec3(dot(camera.w0, column), dot(camera.w1, column), dot(camera.w2, column));
    side = dot(n, p) > 0.0 ? -1.0 : 1.0;
    return side * n;
}

#endif
