#version 460
// feature_distance: distance of two images' features at each pixel (LPIPS, Zhang et al. 2018), and the gradient with
// respect to the features of the first image: sum over channels of w (f / (|f| + eps) - g / (|g| + eps))^2, divided by
// the number of pixels. One thread owns a pixel; one workgroup owns 64 consecutive pixels.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Features { vec4 features[]; };
layout(set = 0, binding = 1) readonly buffer ChannelWeights { vec4 channel_weights[]; };
layout(set = 0, binding = 2) writeonly buffer Parts { float parts[]; };
layout(set = 0, binding = 3) writeonly buffer Grads { vec4 grads[]; };
layout(push_constant) uniform Push {
    uint pixels;  // of an image
    uint quads;   // rows of four channels in a pixel
    uint weight_row;
    uint part_first;
    float eps;
    uint flags;
} push;

const uint FLAG_GATE = 4u;      // no gradient where a feature is not positive
const uint FLAG_GRADIENT = 8u;  // write it

// Difference of two rows at unit length. `precise` products and sums: contracted, a difference of products would not be
// 0 for equal features.
vec4 apart(vec4 f, vec4 g, vec2 inverse) {
    precise vec4 d = f * inverse.x - g * inverse.y;
    return d;
}

void main() {
    const uint pixel = global_index();
    if (pixel >= push.pixels) return;
    const uint f_first = pixel * push.quads;
    const uint g_first = (pixel + push.pixels) * push.quads;
    precise vec2 squares = vec2(0.0);
    for (uint q = 0u; q < push.quads; ++q) {
        const vec4 f = LOAD4(features, f_first + q);
        const vec4 g = LOAD4(features, g_first + q);
        squares += vec2(dot(f, f), dot(g, g));
    }
    const vec2 norm = sqrt(squares);
    const vec2 inverse = 1.0 / (norm + push.eps);
    const float each = 1.0 / float(push.pixels);
    float distance_here = 0.0;
    float along = 0.0;
    for (uint q = 0u; q < push.quads; ++q) {
        const vec4 f = LOAD4(features, f_first + q);
        const vec4 d = apart(f, LOAD4(features, g_first + q), inverse);
        const vec4 wd = LOAD4(channel_weights, push.weight_row + q) * d;
        distance_here += dot(wd, d);
        along += dot(wd, f);
    }
    parts[push.part_first + pixel] = distance_here * each;
    if ((push.flags & FLAG_GRADIENT) == 0u) return;
    // A zero feature has no direction, so its length has no gradient.
    const float radial = norm.x > 0.0 ? along * inverse.x * inverse.x / norm.x : 0.0;
    for (uint q = 0u; q < push.quads; ++q) {
        const vec4 f = LOAD4(features, f_first + q);
        const vec4 d = apart(f, LOAD4(features, g_first + q), inverse);
        vec4 grad = 2.0 * each * (LOAD4(channel_weights, push.weight_row + q) * d * inverse.x - f * radial);
        if ((push.flags & FLAG_GATE) != 0u) grad = mix(vec4(0.0), grad, greaterThan(f, vec4(0.0)));
        grads[f_first + q] = grad;
    }
}
