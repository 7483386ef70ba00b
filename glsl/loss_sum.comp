#version 460
// loss_sum: sums the parts of the loss in a fixed order, and stores (total, L1, SSIM) in a slot of the ring. One
// workgroup of LOCAL_SIZE threads, a multiple of 64; each thread owns every LOCAL_SIZE-th part.
#extension GL_GOOGLE_include_directive : require
layout(local_size_x = 64, local_size_x_id = 0) in;
layout(constant_id = 0) const uint LOCAL_SIZE = 64u;
#include "common.glsl"
layout(set = 0, binding = 0) readonly buffer SsimParts { float ssim_parts[]; };
layout(set = 0, binding = 1) readonly buffer L1Parts { float l1_parts[]; };
layout(set = 0, binding = 2) writeonly buffer Loss { float loss[]; };
layout(push_constant) uniform Push {
    float values;  // channels times unmasked pixels
    uint ssim_count;
    uint l1_count;
    uint slot;
    float lambda;
} push;

shared vec2 sums[LOCAL_SIZE];

void main() {
    const uint t = local_index();
    vec2 sum = vec2(0.0);
    for (uint i = t; i < push.ssim_count; i += LOCAL_SIZE) sum.x += ssim_parts[i];
    for (uint i = t; i < push.l1_count; i += LOCAL_SIZE) sum.y += l1_parts[i];
    sums[t] = sum;
    barrier();
    if (t < 64u) {
        for (uint i = t + 64u; i < LOCAL_SIZE; i += 64u) sum += sums[i];
        sums[t] = sum;
    }
    barrier();
    if (t == 0u && group_index() == 0u) {
        sum = vec2(0.0);
        for (uint i = 0u; i < 64u; ++i) sum += sums[i];
        sum /= push.values;
        loss[4u * push.slot] = (1.0 - push.lambda) * sum.y + push.lambda * (1.0 - sum.x);
        loss[4u * push.slot + 1u] = sum.y;
        loss[4u * push.slot + 2u] = sum.x;
    }
}
