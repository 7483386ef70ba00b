#version 460
// densify_stats: after a view's backward pass, adds what density control wants to know of every splat on screen.
// One thread owns one splat and its row of `stats`; one workgroup owns 64 consecutive splats.
// 3DGS judges gradients in normalised device coordinates, where the image is 2 wide: pixels' gradients times W/2 and H/2.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 2) readonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 3) readonly buffer Grad2d { vec4 grad2d[]; };
layout(set = 0, binding = 4) buffer Stats { vec4 stats[]; };
layout(push_constant) uniform Push { float half_width; float half_height; } push;

// 3 standard deviations along the longer axis in pixels. The covariance is the conic's inverse, so its larger eigenvalue is
// the conic's larger eigenvalue over the conic's determinant.
float screen_radius(float a, float b, float c) {
    const float larger = 0.5 * (a + c) + sqrt(0.25 * (a - c) * (a - c) + b * b);
    return 3.0 * sqrt(larger / max(a * c - b * b, 1e-20));
}

void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS] || tile_counts[i] == 0u) return;
    const uint row = 3u * i;
    const vec2 half_size = vec2(push.half_width, push.half_height);
    const vec2 signed_gradient = LOAD4(grad2d, row).xy * half_size;
    const vec2 absolute_gradient = LOAD4(grad2d, row + 2u).zw * half_size;
    const vec2 ab = LOAD4(splat2d, row).zw;
    const float radius = screen_radius(ab.x, ab.y, LOAD4(splat2d, row + 1u).x);
    vec4 s = LOAD4(stats, i);
    s.x += sqrt(dot(signed_gradient, signed_gradient));
    s.y += sqrt(dot(absolute_gradient, absolute_gradient));
    s.z += 1.0;
    s.w = max(s.w, radius);
    stats[i] = s;
}
