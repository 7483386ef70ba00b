#version 460
// densify_stats: after a view's backward pass, adds to the statistics of density control for every visible splat. One
// thread owns one splat and the first three numbers of its row of `stats` (the fourth belongs to the optimiser); one
// workgroup owns 64 consecutive splats. 3DGS uses gradients in normalised device coordinates, where the image is 2
// wide: gradients per pixel times W/2 and H/2.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 2) readonly buffer Grad2d { vec4 grad2d[]; };
layout(set = 0, binding = 3) buffer Stats { vec4 stats[]; };
layout(push_constant) uniform Push { float half_width; float half_height; } push;

void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS] || tile_counts[i] == 0u) return;
    const uint row = 3u * i;
    const vec2 half_size = vec2(push.half_width, push.half_height);
    const vec2 signed_gradient = LOAD4(grad2d, row).xy * half_size;
    const vec2 absolute_gradient = LOAD4(grad2d, row + 2u).zw * half_size;
    vec4 s = LOAD4(stats, i);
    s.x += sqrt(dot(signed_gradient, signed_gradient));
    s.y += sqrt(dot(absolute_gradient, absolute_gradient));
    s.z += 1.0;
    stats[i] = s;
}
