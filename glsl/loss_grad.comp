#version 460
// loss_grad: filters SSIM's derivatives by the window along rows, and writes the gradient of the loss with respect to
// the render, and sums of |x - y|. One subgroup owns a row and walks along the row, with one pixel per lane in a turn.
//! variant subgroup
//! variant emulated SUBGROUP_EMULATED
//! texels red_planes green_planes blue_planes
#extension GL_GOOGLE_include_directive : require
#include "loss.glsl"
layout(set = 0, binding = 0) readonly buffer Image { vec4 image[]; };
layout(set = 0, binding = 1) readonly buffer Target { uint target[]; };
layout(set = 0, binding = 2) readonly buffer RedPlanes { float red_planes[]; };
layout(set = 0, binding = 3) readonly buffer GreenPlanes { float green_planes[]; };
layout(set = 0, binding = 4) readonly buffer BluePlanes { float blue_planes[]; };
layout(set = 0, binding = 5) writeonly buffer GradImage { vec4 grad_image[]; };
layout(set = 0, binding = 6) writeonly buffer L1Parts { float l1_parts[]; };
layout(set = 0, binding = 7) readonly buffer Saliency { float saliency[]; };
#include "photograph.glsl"
#include "loss_weight.glsl"

// Per channel, the factors of 1, x - y and x - pivot.
struct Derivatives {
    vec4 of[3];
};

Derivatives derivatives_at(uint column, uint row) {
    Derivatives d;
    [[unroll]] for (uint c = 0u; c < 3u; ++c) d.of[c] = vec4(0.0);
    if (column < push.width && row < push.height) {
        const uint k = row * push.width + column;
        d.of[0].xyz = LOAD3(red_planes, k);
        d.of[1].xyz = LOAD3(green_planes, k);
        d.of[2].xyz = LOAD3(blue_planes, k);
    }
    return d;
}

void main() {
    const uint lanes = subgroup_width();
    const uint lane = subgroup_lane();
    const uint row = owner();
    const float each = 1.0 / push.values;
    const float of_l1 = (1.0 - push.lambda) * each;
    const float of_ssim = -push.lambda * each;
    float sum = 0.0;
    Derivatives left;
    [[unroll]] for (uint c = 0u; c < 3u; ++c) left.of[c] = vec4(0.0);
    Derivatives here = derivatives_at(lane, row);
    uint first = 0u;
    do {
        const uint column = first + lane;
        const Derivatives right = derivatives_at(column + lanes, row);
        vec4 spread[3];
        [[unroll]] for (uint c = 0u; c < 3u; ++c) spread[c] = window_across(left.of[c], here.of[c], right.of[c]);
        if (column < push.width && row < push.height) {
            const uint k = row * push.width + column;
            const Seen seen = photograph_at(k);
            const vec3 y = seen.colour;
            const vec3 x = seen.counts ? LOAD4(image, k).rgb : y;
            const vec3 d = x - y;
            sum += abs(d.x) + abs(d.y) + abs(d.z);
            vec3 grad = (WEIGHTED == 0u ? of_l1 : of_l1 * weight_at(k)) * sign(d);
            [[unroll]] for (uint c = 0u; c < 3u; ++c) {
                grad[c] += of_ssim * (spread[c].x + d[c] * spread[c].y + (x[c] - PIVOT) * spread[c].z);
            }
            grad_image[k] = seen.counts ? vec4(grad, 0.0) : vec4(0.0);
        }
        left = here;
        here = right;
        first += lanes;
    } while (first < push.width);
    if (row < push.height) l1_parts[row * lanes + lane] = sum;
}
