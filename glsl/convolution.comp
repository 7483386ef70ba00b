#version 460
// convolution: a convolution of channels-last images; with mirrored filters also the gradient of a convolution. One
// thread owns 8 output channels of PIXELS pixels, a block apart from each other; one workgroup owns 64 consecutive
// threads, and neighbouring threads own neighbouring pixels. A thread reads each row of the filters once for all its
// pixels.
//! texels
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common.glsl"
#include "divide.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Source { vec4 source[]; };
layout(set = 0, binding = 1) readonly buffer Filters { vec4 filters[]; };
layout(set = 0, binding = 2) readonly buffer Biases { vec4 biases[]; };
layout(set = 0, binding = 3) readonly buffer Gate { vec4 gate[]; };
layout(set = 0, binding = 4) buffer Result { vec4 result[]; };
layout(push_constant) uniform Push {
    uint in_width;
    uint in_height;
    uint in_row;      // rows of four channels in a pixel of the source
    uint in_first;    // first row of a pixel to read
    uint in_quads;    // number of rows to read
    uint zero_pixel;  // all-zero pixel of the source, read outside of the image
    uint out_width;
    uint out_height;
    uint out_row;
    uint out_first;
    uint groups;  // of 8 output channels
    uint images;  // 1, or 2 one after the other
    uint size;    // taps along a side
    uint stride;
    uint pad;
    uint filter_row;
    uint bias_row;
    uint flags;
} push;

const uint PIXELS = 4u;
const uint FLAG_ADD = 1u;   // add to the result
const uint FLAG_RELU = 2u;  // negative values become 0
const uint FLAG_GATE = 4u;  // 0 where the gate (same layout as the result) is not positive

vec4 finished(vec4 value, uint at) {
    if ((push.flags & FLAG_ADD) != 0u) value += LOAD4(result, at);
    if ((push.flags & FLAG_RELU) != 0u) value = max(value, vec4(0.0));
    if ((push.flags & FLAG_GATE) != 0u) value = mix(vec4(0.0), value, greaterThan(LOAD4(gate, at), vec4(0.0)));
    return value;
}

void main() {
    const uint of_image = push.out_width * push.out_height;
    const uint pixels = of_image * push.images;
    const uint blocks = (pixels + PIXELS - 1u) / PIXELS;
    const uint group = quotient(global_index(), blocks);
    const uint block = global_index() - group * blocks;
    if (group >= push.groups) return;

    vec4 low[PIXELS];
    vec4 high[PIXELS];
    uvec2 corner[PIXELS];
    uint image_first[PIXELS];
    const vec4 bias_low = LOAD4(biases, push.bias_row + 2u * group);
    const vec4 bias_high = LOAD4(biases, push.bias_row + 2u * group + 1u);
    [[unroll]] for (uint p = 0u; p < PIXELS; ++p) {
        const uint pixel = min(block + p * blocks, pixels - 1u);
        const uint image = pixel < of_image ? 0u : 1u;
        const uint y = quotient(pixel - image * of_image, push.out_width);
        const uint x = pixel - image * of_image - y * push.out_width;
        // Left of and above the image the coordinate wraps to a large number, which is outside too.
        corner[p] = uvec2(x, y) * push.stride - push.pad;
        image_first[p] = image * push.in_width * push.in_height;
        low[p] = bias_low;
        high[p] = bias_high;
    }
    uint row = push.filter_row + 8u * group * push.size * push.size * push.in_quads;
    // All three loops test at their end, see common.glsl.
    uint tap_y = 0u;
    do {
        uint tap_x = 0u;
        do {
            uint from[PIXELS];
            [[unroll]] for (uint p = 0u; p < PIXELS; ++p) {
                const uvec2 at = corner[p] + uvec2(tap_x, tap_y);
                const bool inside = at.x < push.in_width && at.y < push.in_height;
                const uint pixel = inside ? image_first[p] + at.y * push.in_width + at.x : push.zero_pixel;
                from[p] = pixel * push.in_row + push.in_first;
            }
            uint quad = 0u;
            do {
                vec4 f[8];
                [[unroll]] for (uint k = 0u; k < 8u; ++k) f[k] = LOAD4(filters, row + k);
                [[unroll]] for (uint p = 0u; p < PIXELS; ++p) {
                    const vec4 v = LOAD4(source, from[p] + quad);
                    low[p] += v.x * f[0];
                    high[p] += v.x * f[1];
                    low[p] += v.y * f[2];
                    high[p] += v.y * f[3];
                    low[p] += v.z * f[4];
                    high[p] += v.z * f[5];
                    low[p] += v.w * f[6];
                    high[p] += v.w * f[7];
                }
                row += 8u;
                ++quad;
            } while (quad < push.in_quads);
            ++tap_x;
        } while (tap_x < push.size);
        ++tap_y;
    } while (tap_y < push.size);
    [[unroll]] for (uint p = 0u; p < PIXELS; ++p) {
        const uint pixel = block + p * blocks;
        if (pixel < pixels) {
            const uint at = pixel * push.out_row + push.out_first + 2u * group;
            result[at] = finished(low[p], at);
            result[at + 1u] = finished(high[p], at + 1u);
        }
    }
}
