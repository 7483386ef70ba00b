#version 460
// distance_sum: sums the parts of a perceptual distance in a fixed order: a sum per layer, then the sum of all layers.
// One workgroup of 64 threads; each thread owns every 64th part of every layer.
#extension GL_GOOGLE_include_directive : require
layout(local_size_x = 64) in;
#include "common.glsl"
layout(set = 0, binding = 0) readonly buffer Parts { float parts[]; };
layout(set = 0, binding = 1) writeonly buffer Result { float result[]; };
layout(push_constant) uniform Push {
    uint ends[8];  // ends of the layers' parts; a layer begins at the end of the previous layer
    uint layers;   // at most 8
} push;

shared float sums[512];

void main() {
    const uint t = local_index();
    for (uint layer = 0u; layer < push.layers; ++layer) {
        const uint first = layer == 0u ? 0u : push.ends[layer - 1u];
        float sum = 0.0;
        for (uint i = first + t; i < push.ends[layer]; i += 64u) sum += parts[i];
        sums[64u * layer + t] = sum;
    }
    barrier();
    if (t == 0u && group_index() == 0u) {
        float total = 0.0;
        for (uint layer = 0u; layer < push.layers; ++layer) {
            float sum = 0.0;
            for (uint i = 0u; i < 64u; ++i) sum += sums[64u * layer + i];
            result[layer] = sum;
            total += sum;
        }
        result[push.layers] = total;
    }
}
