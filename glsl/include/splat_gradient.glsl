// Gradients of one splat's parameters from the gradients of its 2D Gaussian, shared by the pass that writes the
// gradients and the pass fused with the optimiser.
#ifndef SPLAT_GRADIENT_GLSL
#define SPLAT_GRADIENT_GLSL
#include "projection.glsl"
#include "sh.glsl"

struct SplatParams {
    vec3 mean;
    vec4 quat;
    vec3 log_scale;
    float logit;
    vec4 sh[12];  // four groups; groups above the degree are not read
};

struct SplatGradient {
    vec3 mean;
    vec4 quat;
    vec3 log_scale;
    float logit;
    vec3 rgb;  // gradient of the colour: the gradient of sh coefficient k is basis value k times this
    vec3 dir;  // direction of the basis
};

// A row of grad2d, and the normal's gradient.
struct Gradient2d {
    vec4 a;  // mean x, mean y, A, B
    vec4 b;  // C, opacity, r, g
    vec4 c;  // b, depth, abs x, abs y
    vec3 normal;
};

SplatGradient no_gradient() {
    return SplatGradient(vec3(0.0), vec4(0.0), vec3(0.0), 0.0, vec3(0.0), vec3(0.0));
}

// `stored` is the colour that was blended. `flags` are VIEW_*. The normal takes part where `with_normal`.
SplatGradient splat_gradient(Camera camera, uint degree, uint flags, SplatParams s, vec3 stored, Gradient2d up,
                             bool with_normal) {
    SplatGradient result;
    // Colour: max(0, .) passes no gradient where the stored colour is 0, except, with VIEW_BLACK_LEARNS, a gradient
    // that raises the colour.
    const vec3 g_stored = vec3(up.b.zw, up.c.x);
    const vec3 raising = (flags & VIEW_BLACK_LEARNS) != 0u ? mix(vec3(0.0), g_stored, lessThan(g_stored, vec3(0.0))) : vec3(0.0);
    const vec3 g_rgb = mix(raising, g_stored, greaterThan(stored, vec3(0.0)));
    const vec3 offset = s.mean - camera.center;
    const float distance = length(offset);
    const vec3 dir = offset / distance;
    vec3 g_dir = sh_slope0(sh_dot(g_rgb, s.sh[0], s.sh[1], s.sh[2]), degree);
    if (degree >= 2u) {
        g_dir += sh_slope1(dir, sh_dot(g_rgb, s.sh[3], s.sh[4], s.sh[5])) +
                 sh_slope2(dir, sh_dot(g_rgb, s.sh[6], s.sh[7], s.sh[8]), degree);
    }
    if (degree >= 3u) g_dir += sh_slope3(dir, sh_dot(g_rgb, s.sh[9], s.sh[10], s.sh[11]));
    const vec3 g_offset = (g_dir - dir * dot(dir, g_dir)) / distance;
    result.rgb = g_rgb;
    result.dir = dir;

    const vec3 p = to_camera(camera, s.mean);
    const Ewa e = ewa_project(camera, p, s.quat, s.log_scale);

    // Opacity, with the anti-aliasing factor between the sigmoid and the blended opacity.
    const vec2 sigma = sigmoid(s.logit);
    const bool antialias = (flags & VIEW_ANTIALIAS) != 0u;
    result.logit = up.b.y * sigma.y * (antialias ? e.compensation : 1.0);
    const float g_compensation = antialias ? up.b.y * sigma.x : 0.0;

    vec3 g_axis = vec3(0.0);
    uint axis = 0u;
    if (with_normal) {
        axis = shortest_axis(s.log_scale);
        float side;
        splat_normal(camera, p, e.rot, axis, side);
        const vec3 g_normal = side * up.normal;
        g_axis = camera.w0 * g_normal.x + camera.w1 * g_normal.y + camera.w2 * g_normal.z;
    }
    // A moved mean moves the plane of the depths along. The slopes count as constants.
    const vec2 moved = (with_normal ? up.a.xy - up.c.y * depth_slope(e) : up.a.xy) * e.zoom;
    EwaGrad g = ewa_backward(camera, e, p.z, vec3(up.a.zw, up.b.x), g_compensation, g_axis, axis,
                             (flags & VIEW_REFERENCE_CLAMP) != 0u);
    g.p.xy += moved;
    g.p.z += up.c.y - dot(moved, p.xy / p.z);
    result.mean = camera.w0 * g.p.x + camera.w1 * g.p.y + camera.w2 * g.p.z + g_offset;
    result.quat = g.quat;
    result.log_scale = g.log_scale;
    return result;
}

// Adds the derivative of `weight` times the splat's smallest standard deviation (planar splats: PGSR, Chen et al.
// 2024).
void flatten(inout SplatGradient g, vec3 log_scale, float weight) {
    const float slope = weight * exp(min(log_scale.x, min(log_scale.y, log_scale.z)));
    g.log_scale += mix(vec3(0.0), vec3(slope), equal(uvec3(shortest_axis(log_scale)), uvec3(0u, 1u, 2u)));
}

// Adds the derivatives of `opacity` times the splat's opacity, and of `scale` times the mean of its standard deviations
// (3DGS-MCMC, Kheradmand et al. 2024). `precise`, so that all passes get the same bits.
void price(inout SplatGradient g, vec3 log_scale, float logit, float opacity, float scale) {
    precise float logit_sum = g.logit + opacity * sigmoid(logit).y;
    precise vec3 scale_sum = g.log_scale + (scale / 3.0) * exp(log_scale);
    g.logit = logit_sum;
    g.log_scale = scale_sum;
}

// Adds the derivative of `weight` times o (1 - o) of the splat's opacity o.
void decide(inout SplatGradient g, float logit, float weight) {
    const vec2 o = sigmoid(logit);
    precise float sum = g.logit + weight * (o.y * (1.0 - 2.0 * o.x));
    g.logit = sum;
}

// The weight for coefficients of degree 1, 2 and 3: zero above the degree in use.
vec3 of_degrees(float weight, uint degree) {
    return mix(vec3(0.0), vec3(weight), lessThanEqual(uvec3(1u, 2u, 3u), uvec3(degree)));
}

// Adds the derivative of `weight` times half the square of coefficients. `precise`, so that all passes get the same
// bits.
vec4 shrunk(vec4 g, vec4 sh, vec4 weight) {
    precise vec4 sum = g + weight * sh;
    return sum;
}

// The same for the specialization constant SHRINK of a pass; reads nothing if SHRINK is zero.
#define SHRUNK(g, sh, weight) (SHRINK != 0u ? shrunk(g, sh, weight) : (g))

// A group of SH gradients is the outer product of its basis values and the colour's gradient.
vec4 sh_outer0(vec4 basis, vec3 g) { return vec4(basis.x * g, basis.y * g.x); }
vec4 sh_outer1(vec4 basis, vec3 g) { return vec4(basis.y * g.yz, basis.z * g.xy); }
vec4 sh_outer2(vec4 basis, vec3 g) { return vec4(basis.z * g.z, basis.w * g); }

#endif
