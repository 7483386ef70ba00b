#version 460
// pool: the largest of 3x3 values, at every second pixel; windows may extend past the right and the lower edge (ceil
// mode). One thread owns four channels of an output pixel; one workgroup owns 64 consecutive threads. The first of
// equal values wins.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "divide.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Source { vec4 source[]; };
layout(set = 0, binding = 1) writeonly buffer Result { vec4 result[]; };
layout(set = 0, binding = 2) writeonly buffer Winners { uint winners[]; };
layout(push_constant) uniform Push {
    uint in_width;
    uint in_height;
    uint out_width;
    uint out_height;
    uint quads;   // rows of four channels in a pixel
    uint images;  // 1, or 2 one after the other
} push;

void main() {
    const uint of_image = push.out_width * push.out_height;
    const uint index = global_index();
    if (index >= of_image * push.images * push.quads) return;
    const uint pixel = quotient(index, push.quads);
    const uint quad = index - pixel * push.quads;
    const uint image = pixel < of_image ? 0u : 1u;
    const uint y = quotient(pixel - image * of_image, push.out_width);
    const uint x = pixel - image * of_image - y * push.out_width;
    const uint first = image * push.in_width * push.in_height;
    vec4 best = vec4(0.0);
    uvec4 winner = uvec4(0u);
    for (uint tap = 0u; tap < 9u; ++tap) {
        const uvec2 at = 2u * uvec2(x, y) + uvec2(tap % 3u, tap / 3u);
        const bool inside = at.x < push.in_width && at.y < push.in_height;
        const uvec2 clamped = min(at, uvec2(push.in_width, push.in_height) - 1u);
        const vec4 value = LOAD4(source, (first + clamped.y * push.in_width + clamped.x) * push.quads + quad);
        const bvec4 larger = greaterThan(value, best);
        const bvec4 wins = bvec4(
            inside && (tap == 0u || larger.x), inside && (tap == 0u || larger.y), inside && (tap == 0u || larger.z),
            inside && (tap == 0u || larger.w));
        best = mix(best, value, wins);
        winner = mix(winner, uvec4(tap), wins);
    }
    result[index] = best;
    winners[index] = winner.x | winner.y << 8 | winner.z << 16 | winner.w << 24;
}
