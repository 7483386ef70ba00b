#version 460
// part_sum: sums rows of four floats in a fixed order, and stores the sum in a slot. One workgroup of 64 threads; each
// thread owns every 64th row.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Parts { vec4 parts[]; };
layout(set = 0, binding = 1) writeonly buffer Sums { vec4 part_sums[]; };
layout(push_constant) uniform Push {
    uint count;
    uint slot;
} push;

shared vec4 sums[64];

void main() {
    const uint t = local_index();
    vec4 sum = vec4(0.0);
    for (uint i = t; i < push.count; i += 64u) sum += LOAD4(parts, i);
    sums[t] = sum;
    barrier();
    if (t == 0u && group_index() == 0u) {
        sum = vec4(0.0);
        for (uint i = 0u; i < 64u; ++i) sum += sums[i];
        part_sums[push.slot] = sum;
    }
}
