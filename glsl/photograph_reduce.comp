#version 460
// photograph_reduce: a photograph at a fraction of its size. A pixel of the result is the mean of the unmasked pixels
// among FACTOR x FACTOR pixels, and is masked when fewer than half of them are unmasked. Remaining columns and rows are
// left out. One thread owns a pixel of the result; one workgroup owns 64 consecutive ones.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Target { uint target[]; };
layout(set = 0, binding = 1) writeonly buffer Reduced { uint reduced[]; };
layout(push_constant) uniform Push {
    uint width;   // of the photograph
    uint height;
    uint factor;
} push;
#include "photograph.glsl"

void main() {
    const uint k = global_index();
    const uvec2 size = uvec2(push.width, push.height) / push.factor;
    if (k >= size.x * size.y) return;
    const uvec2 corner = push.factor * uvec2(k % size.x, k / size.x);
    vec3 sum = vec3(0.0);
    uint counted = 0u;
    for (uint y = 0u; y < push.factor; ++y) {
        for (uint x = 0u; x < push.factor; ++x) {
            const Seen seen = photograph_at((corner.y + y) * push.width + corner.x + x);
            if (seen.counts) {
                sum += seen.colour;
                ++counted;
            }
        }
    }
    const bool counts = 2u * counted >= push.factor * push.factor;
    const vec4 mean = counts ? vec4(sum / float(max(counted, 1u)), 1.0) : vec4(0.0);
    if (PHOTOGRAPH_BITS == 16u) {
        reduced[2u * k] = packUnorm2x16(mean.rg);
        reduced[2u * k + 1u] = packUnorm2x16(mean.ba);
    } else {
        reduced[k] = packUnorm4x8(mean);
    }
}
