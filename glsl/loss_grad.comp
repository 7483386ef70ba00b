#version 460
// loss_grad: filters SSIM's derivatives by the window, and writes the gradient of the loss with respect to the render,
// and sums of |x - y|. subgroup, for CPU devices: the derivatives were filtered along columns; one subgroup owns a row
// and walks along the row, with one pixel per lane in a turn. APART, for GPUs: one subgroup owns one channel of a strip,
// as in loss_strips, and filters along columns too.
//! variant subgroup
//! variant apart APART
//! variant emulated SUBGROUP_EMULATED APART
//! texels red_planes green_planes blue_planes
#extension GL_GOOGLE_include_directive : require
#include "loss.glsl"
#ifdef APART
layout(constant_id = 1) const uint SEGMENT = 64u;
#endif
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
    vec4 of[CHANNELS];
};

Derivatives no_derivatives() {
    Derivatives d;
    [[unroll]] for (uint c = 0u; c < CHANNELS; ++c) d.of[c] = vec4(0.0);
    return d;
}

Derivatives derivatives_at(uint column, uint row) {
    Derivatives d = no_derivatives();
    if (column < push.width && row < push.height) {
        const uint k = row * push.width + column;
#ifdef APART
        if (first_channel() == 0u) d.of[0].xyz = LOAD3(red_planes, k);
        else if (first_channel() == 1u) d.of[0].xyz = LOAD3(green_planes, k);
        else d.of[0].xyz = LOAD3(blue_planes, k);
#else
        d.of[0].xyz = LOAD3(red_planes, k);
        d.of[1].xyz = LOAD3(green_planes, k);
        d.of[2].xyz = LOAD3(blue_planes, k);
#endif
    }
    return d;
}

// Writes the gradient at pixel k from the filtered derivatives; returns the sum of |x - y| over the channels.
float write_gradient(uint k, vec4 spread[CHANNELS]) {
    const float each = 1.0 / push.values;
    const float of_l1 = (1.0 - push.lambda) * each;
    const float of_ssim = -push.lambda * each;
    const Seen seen = photograph_at(k);
    const vec3 y = seen.colour;
    const vec3 x = seen.counts ? LOAD4(image, k).rgb : y;
    const vec3 d = x - y;
    const float l1 = WEIGHTED == 0u ? of_l1 : of_l1 * weight_at(k);
#ifdef APART
    const uint channel = first_channel();
    const float own = d[channel];
    const float ssim = of_ssim * (spread[0].x + own * spread[0].y + (x[channel] - PIVOT) * spread[0].z);
    const float grad = seen.counts ? l1 * sign(own) + ssim : 0.0;
    if (channel == 0u) grad_image[k].x = grad;
    else if (channel == 1u) grad_image[k].y = grad;
    else grad_image[k].zw = vec2(grad, 0.0);
    return abs(own);
#else
    vec3 grad = l1 * sign(d);
    [[unroll]] for (uint c = 0u; c < 3u; ++c) {
        grad[c] += of_ssim * (spread[c].x + d[c] * spread[c].y + (x[c] - PIVOT) * spread[c].z);
    }
    grad_image[k] = seen.counts ? vec4(grad, 0.0) : vec4(0.0);
    return abs(d.x) + abs(d.y) + abs(d.z);
#endif
}

#ifdef APART

void main() {
    const uint lanes = subgroup_width();
    const uint strips = (push.width + lanes - 1u) / lanes;
    const uint strip = owner() / 3u;
    const uint column = strip % strips * lanes + subgroup_lane();
    const uint segment = strip / strips;
    const uint first = segment * SEGMENT;
    const uint end = min(first + SEGMENT, push.height);
    // Equal for all strips, because emulated subgroups of a workgroup share barriers.
    const uint walked = min(SEGMENT, push.height) + 2u * WINDOW_RADIUS;
    const uvec2 columns = columns_beside(column, lanes);
    Window back = window_empty();
    float sum = 0.0;
    // Turn i reads row i - 5 and writes the row five rows before. Rows before the first wrap to large numbers.
    uint i = first;
    do {
        const uint taken = i - WINDOW_RADIUS;
        const uint center = taken - WINDOW_RADIUS;
        const Derivatives here = derivatives_at(column, taken);
        const Derivatives left = derivatives_at(columns.x, taken);
        Derivatives right = left;
        if (lanes < 2u * WINDOW_RADIUS) right = derivatives_at(columns.y, taken);
        vec4 spread[1];
        spread[0] = window_take(back, window_across(left.of[0], here.of[0], right.of[0]));
        if (center >= first && center < end && column < push.width) {
            sum += write_gradient(center * push.width + column, spread);
        }
        ++i;
    } while (i < first + walked);
    if (first < push.height && column < push.width) {
        l1_parts[(segment * 3u + first_channel()) * push.width + column] = sum;
    }
}

#else

void main() {
    const uint lanes = subgroup_width();
    const uint lane = subgroup_lane();
    const uint row = owner();
    float sum = 0.0;
    Derivatives left = no_derivatives();
    Derivatives here = derivatives_at(lane, row);
    uint first = 0u;
    do {
        const uint column = first + lane;
        const Derivatives right = derivatives_at(column + lanes, row);
        vec4 spread[3];
        [[unroll]] for (uint c = 0u; c < 3u; ++c) spread[c] = window_across(left.of[c], here.of[c], right.of[c]);
        if (column < push.width && row < push.height) sum += write_gradient(row * push.width + column, spread);
        left = here;
        here = right;
        first += lanes;
    } while (first < push.width);
    if (row < push.height) l1_parts[row * lanes + lane] = sum;
}

#endif
