#version 460
// gradient_map_windows: second pass of the gradient-map loss (see gradient_map.glsl): correlations in windows.
// Overwrites a pixel's row with m dr/da times the direction of the render's gradient: the derivative with respect to
// (gx, gy). One workgroup of 64 threads owns a window of 32x32 pixels and its row of windows: (m r, m, 0, 0). One
// thread owns 16 pixels of the window, every second pixel of a column.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "gradient_map.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
// 0: no mask, M = 1.
layout(constant_id = 0) const uint MASK = 0u;
layout(set = 0, binding = 0) readonly buffer Mask { uint mask[]; };
layout(set = 0, binding = 1) buffer Maps { vec4 maps[]; };
layout(set = 0, binding = 2) writeonly buffer Windows { vec4 windows[]; };
#include "mask.glsl"

// Magnitude of a flat region, the pivot of the sums: flat windows then have mean 0 without rounding errors.
const float FLAT = 1e-3;

shared vec4 sums[64];
shared vec4 total;

// Sums over the workgroup, in the order of the threads.
vec4 over_window(vec4 own) {
    sums[local_index()] = own;
    barrier();
    if (local_index() == 0u) {
        vec4 sum = vec4(0.0);
        for (uint i = 0u; i < 64u; ++i) sum += sums[i];
        total = sum;
    }
    barrier();
    return total;
}

void main() {
    const uint across = (push.width + WINDOW_SIDE - 1u) / WINDOW_SIDE;
    const uint count = across * ((push.height + WINDOW_SIDE - 1u) / WINDOW_SIDE);
    const uint window = group_index();
    const uint x = window % across * WINDOW_SIDE + local_index() % WINDOW_SIDE;
    const uint first = window / across * WINDOW_SIDE + local_index() / WINDOW_SIDE;
    // Rows of the thread's pixels: first, first + 2, ... below `end`.
    const uint end = window < count && x < push.width ? min(push.height, window / across * WINDOW_SIDE + WINDOW_SIDE) : 0u;

    vec4 own = vec4(0.0);
    for (uint y = first; y < end; y += 2u) {
        const vec4 row = LOAD4(maps, y * push.width + x);
        float weight = 1.0;
        if (MASK != 0u) weight = mask_at(uvec2(x, y), uvec2(push.width, push.height), uvec2(push.mask_width, push.mask_height));
        if (row.x > 0.0) own += vec4(row.xy - FLAT, weight, 1.0);
    }
    const vec4 first_moments = over_window(own);
    const float m = first_moments.z;
    const vec2 mean = first_moments.xy / max(first_moments.w, 1.0);

    own = vec4(0.0);
    for (uint y = first; y < end; y += 2u) {
        const vec4 row = LOAD4(maps, y * push.width + x);
        const vec2 d = row.xy - FLAT - mean;
        if (row.x > 0.0) own += vec4(d * d, d.x * d.y, 0.0);
    }
    const vec4 second_moments = over_window(own);
    const vec2 size = sqrt(second_moments.xy);
    const vec2 inverse = 1.0 / max(size, vec2(LENGTH_FLOOR));
    const float r = second_moments.z * inverse.x * inverse.y;
    // dr/da = (b - mean b) of_b - (a - mean a) of_a; a length at the floor does not depend on a.
    const float of_b = m * inverse.x * inverse.y;
    const float of_a = size.x > LENGTH_FLOOR ? m * r * inverse.x * inverse.x : 0.0;
    for (uint y = first; y < end; y += 2u) {
        const uint k = y * push.width + x;
        const vec4 row = LOAD4(maps, k);
        const vec2 d = row.xy - FLAT - mean;
        maps[k] = row.x > 0.0 ? vec4((d.y * of_b - d.x * of_a) / row.x * row.zw, 0.0, 0.0) : vec4(0.0);
    }
    if (local_index() == 0u && window < count) windows[window] = vec4(m * r, m, 0.0, 0.0);
}
