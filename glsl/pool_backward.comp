#version 460
// pool_backward: passes the gradient of every maximum to the source pixel of the maximum. One thread owns four channels
// of an input pixel and reads the up to four windows that cover the pixel; one workgroup owns 64 consecutive threads.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "divide.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer GradOut { vec4 grad_out[]; };
layout(set = 0, binding = 1) readonly buffer Winners { uint winners[]; };
layout(set = 0, binding = 2) readonly buffer Gate { vec4 gate[]; };
layout(set = 0, binding = 3) buffer GradIn { vec4 grad_in[]; };
layout(push_constant) uniform Push {
    uint in_width;
    uint in_height;
    uint out_width;
    uint out_height;
    uint quads;  // rows of four channels in a pixel
    uint flags;
} push;

const uint FLAG_ADD = 1u;   // add to grad_in
const uint FLAG_GATE = 4u;  // 0 where the gate (same layout as grad_in) is not positive

void main() {
    const uint index = global_index();
    if (index >= push.in_width * push.in_height * push.quads) return;
    const uint pixel = quotient(index, push.quads);
    const uint quad = index - pixel * push.quads;
    const uint y = quotient(pixel, push.in_width);
    const uint x = pixel - y * push.in_width;
    vec4 sum = vec4(0.0);
    if ((push.flags & FLAG_ADD) != 0u) sum = LOAD4(grad_in, index);
    for (uint k = 0u; k < 4u; ++k) {
        // The windows that begin at or before the pixel; left of and above the image their indices wrap to large
        // numbers, which are outside.
        const uvec2 window = uvec2(x, y) / 2u - uvec2(k & 1u, k >> 1);
        const uvec2 within = uvec2(x, y) - 2u * window;
        if (window.x < push.out_width && window.y < push.out_height && within.x < 3u && within.y < 3u) {
            const uint at = (window.y * push.out_width + window.x) * push.quads + quad;
            const uint won = winners[at];
            const uvec4 winner = uvec4(won, won >> 8, won >> 16, won >> 24) & 255u;
            sum += mix(vec4(0.0), LOAD4(grad_out, at), equal(winner, uvec4(3u * within.y + within.x)));
        }
    }
    if ((push.flags & FLAG_GATE) != 0u) sum = mix(vec4(0.0), sum, greaterThan(LOAD4(gate, index), vec4(0.0)));
    grad_in[index] = sum;
}
