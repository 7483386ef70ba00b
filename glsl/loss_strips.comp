#version 460
// loss_strips: SSIM and its derivatives with respect to the moments. One subgroup owns a strip, one column per lane and
// SEGMENT rows (or all rows of a smaller image), and walks down the strip; one thread owns a column. subgroup, for CPU
// devices: all channels, and the derivatives are filtered by the window along columns. These devices merge all changed
// variables at every turn of a loop, so a turn takes three rows. APART, for GPUs, where few registers and many subgroups
// count: a subgroup owns one channel of a strip, and loss_grad filters the derivatives.
//! variant subgroup
//! variant apart APART
//! variant emulated SUBGROUP_EMULATED APART
//! texels
#extension GL_GOOGLE_include_directive : require
#include "loss.glsl"
layout(constant_id = 1) const uint SEGMENT = 64u;
layout(set = 0, binding = 0) readonly buffer Image { vec4 image[]; };
layout(set = 0, binding = 1) readonly buffer Target { uint target[]; };
layout(set = 0, binding = 2) writeonly buffer RedPlanes { float red_planes[]; };
layout(set = 0, binding = 3) writeonly buffer GreenPlanes { float green_planes[]; };
layout(set = 0, binding = 4) writeonly buffer BluePlanes { float blue_planes[]; };
layout(set = 0, binding = 5) writeonly buffer SsimParts { float ssim_parts[]; };
layout(set = 0, binding = 6) readonly buffer Saliency { float saliency[]; };
#include "photograph.glsl"
#include "loss_weight.glsl"

#ifdef APART
const uint ROWS = 1u;
// Rows that a strip reads beyond each of its ends.
const uint REACH = WINDOW_RADIUS;
#else
const uint ROWS = 3u;
const uint REACH = 2u * WINDOW_RADIUS;
#endif

// Per channel (x, x - y, (x - y)^2, x^2 + y^2); x and y are relative to the pivot.
struct Moments {
    vec4 of[CHANNELS];
    bool counts;
};

Moments moments_at(uint column, uint row) {
    vec3 x = vec3(0.0);
    vec3 y = vec3(0.0);
    Moments moments;
    moments.counts = false;
    if (column < push.width && row < push.height) {
        const uint k = row * push.width + column;
        const Seen seen = photograph_at(k);
        moments.counts = seen.counts;
        y = seen.colour;
        x = seen.counts ? LOAD4(image, k).rgb : y;
    }
#ifdef APART
    const uint channel = first_channel();
    x.x = x[channel];
    y.x = y[channel];
#endif
    [[unroll]] for (uint c = 0u; c < CHANNELS; ++c) {
        const float d = x[c] - y[c];
        const vec2 p = vec2(x[c], y[c]) - PIVOT;
        moments.of[c] = vec4(p.x, d, d * d, dot(p, p));
    }
    return moments;
}

// SSIM, and in `derivatives` the factors of 1, x - y and x - pivot in its derivative.
float ssim(vec4 mean, out vec4 derivatives) {
    const float m = mean.y;
    const float mu1 = mean.x + PIVOT;
    const float mu2 = mu1 - m;
    const float pivoted2 = mean.x - m;
    const float inv_a = 1.0 / (mu1 * mu1 + mu2 * mu2 + C1);
    const float inv_b = 1.0 / (max(mean.w - mean.x * mean.x - pivoted2 * pivoted2, 0.0) + C2);
    const float v = max(mean.z - m * m, 0.0);
    const float luminance = 1.0 - m * m * inv_a;
    const float structure = 1.0 - v * inv_b;
    const float of_b = 2.0 * luminance * v * inv_b * inv_b;
    derivatives = vec4(
        2.0 * structure * m * inv_a * (mu1 * m * inv_a - 1.0) + 2.0 * luminance * m * inv_b - of_b * mean.x,
        -2.0 * luminance * inv_b, of_b, 0.0);
    return luminance * structure;
}

void main() {
    const uint lanes = subgroup_width();
    const uint strips = (push.width + lanes - 1u) / lanes;
    const uint strip = owner() / (3u / CHANNELS);
    const uint column = strip % strips * lanes + subgroup_lane();
    const uint segment = strip / strips;
#ifdef APART
    const uvec2 columns = columns_beside(column, lanes);
#endif
    const uint first = segment * SEGMENT;
    const uint end = min(first + SEGMENT, push.height);
    // Equal for all strips, because emulated subgroups of a workgroup share barriers.
    const uint walked = min(SEGMENT, push.height) + 2u * REACH;
    Window moments[CHANNELS];
    [[unroll]] for (uint c = 0u; c < CHANNELS; ++c) moments[c] = window_empty();
#ifndef APART
    Window back[CHANNELS];
    [[unroll]] for (uint c = 0u; c < CHANNELS; ++c) back[c] = window_empty();
#endif
    float sum = 0.0;
    // Bit j: whether this column's pixel of j rows ago counts (is not masked).
    uint counts = 0u;
    // Turn i reads row i - REACH, computes SSIM five rows before, and without APART finishes the derivatives five rows
    // before that. Rows before the first wrap to large numbers, which are outside, as are rows past the last.
    uint at = first;
    do {
        [[unroll]] for (uint u = 0u; u < ROWS; ++u) {
            const uint i = at + u;
            const uint taken = i - REACH;
            const uint center = taken - WINDOW_RADIUS;
            const Moments here = moments_at(column, taken);
#ifdef APART
            const uint done = center;
            const Moments left = moments_at(columns.x, taken);
            Moments right = left;
            if (lanes < 2u * WINDOW_RADIUS) right = moments_at(columns.y, taken);
#else
            const uint done = center - WINDOW_RADIUS;
            const Moments left = moments_at(column - lanes, taken);
            const Moments right = moments_at(column + lanes, taken);
#endif
            counts = counts << 1 | uint(here.counts);
            const bool center_counts = (counts >> WINDOW_RADIUS & 1u) != 0u;
            const float weight = center_counts ? weight_at(center * push.width + column) : 0.0;
            vec4 spread[CHANNELS];
            [[unroll]] for (uint c = 0u; c < CHANNELS; ++c) {
                const vec4 mean = window_take(moments[c], window_across(left.of[c], here.of[c], right.of[c]));
                vec4 derivatives;
                const float value = ssim(mean, derivatives);
                sum += center >= first && center < end && center_counts ? value : 0.0;
                spread[c] = center_counts ? weight * derivatives : vec4(0.0);
#ifndef APART
                spread[c] = window_take(back[c], spread[c]);
#endif
            }
            if (done >= first && done < end && column < push.width) {
                const uint k = 3u * (done * push.width + column);
#ifdef APART
                [[unroll]] for (uint j = 0u; j < 3u; ++j) {
                    if (first_channel() == 0u) red_planes[k + j] = spread[0][j];
                    else if (first_channel() == 1u) green_planes[k + j] = spread[0][j];
                    else blue_planes[k + j] = spread[0][j];
                }
#else
                [[unroll]] for (uint j = 0u; j < 3u; ++j) {
                    red_planes[k + j] = spread[0][j];
                    green_planes[k + j] = spread[1][j];
                    blue_planes[k + j] = spread[2][j];
                }
#endif
            }
        }
        at += ROWS;
    } while (at < first + walked);
    const uint row = segment * (3u / CHANNELS) + first_channel();
    if (first < push.height && column < push.width) ssim_parts[row * push.width + column] = sum;
}
