#version 460
// exposure_backward: turns the gradient of the exposed render into the gradient of the render, in place, and writes
// partial sums of the gradient of the photograph's 12 numbers. One thread owns 16 pixels, every 64th of the 1024
// consecutive pixels of its workgroup; the workgroup owns a row of 12 parts, summed over its threads in order.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common.glsl"
#include "exposure.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Image { vec4 image[]; };
layout(set = 0, binding = 1) readonly buffer Exposures { float exposures[]; };
layout(set = 0, binding = 2) buffer GradImage { vec4 grad_image[]; };
layout(set = 0, binding = 3) writeonly buffer ExposureParts { float exposure_parts[]; };
layout(push_constant) uniform Push {
    uint pixels;
    uint view;   // row of the photograph
    uint views;  // photographs
} push;

shared float sums[64 * 12];

void main() {
    const uint t = local_index();
    float e[12];
    float sum[12];
    [[unroll]] for (uint k = 0u; k < EXPOSURE_NUMBERS; ++k) {
        e[k] = exposures[EXPOSURE_ROW * push.view + k] - exposures[EXPOSURE_ROW * push.views + k];
        sum[k] = 0.0;
    }
    const uint first = group_index() * EXPOSURE_PIXELS + t;
    for (uint i = 0u; i < EXPOSURE_PIXELS; i += 64u) {
        if (first + i < push.pixels) {
            const vec3 g = grad_image[first + i].rgb;
            const vec3 c = image[first + i].rgb;
            [[unroll]] for (uint k = 0u; k < 3u; ++k) {
                sum[4u * k] += g[k] * c.r;
                sum[4u * k + 1u] += g[k] * c.g;
                sum[4u * k + 2u] += g[k] * c.b;
                sum[4u * k + 3u] += g[k];
            }
            grad_image[first + i] = vec4(
                g.r + (e[0] * g.r + e[4] * g.g + e[8] * g.b),
                g.g + (e[1] * g.r + e[5] * g.g + e[9] * g.b),
                g.b + (e[2] * g.r + e[6] * g.g + e[10] * g.b),
                0.0);
        }
    }
    [[unroll]] for (uint k = 0u; k < EXPOSURE_NUMBERS; ++k) sums[12u * t + k] = sum[k];
    barrier();
    if (t < EXPOSURE_NUMBERS && group_index() * EXPOSURE_PIXELS < push.pixels) {
        float total = 0.0;
        for (uint i = 0u; i < 64u; ++i) total += sums[12u * i + t];
        exposure_parts[12u * group_index() + t] = total;
    }
}
