#version 460
// slot_sum: sums the slots of each visible splat, in order, into the splat's rows of grad2d and grad_normals. One
// thread owns four columns of one visible splat: quads 0 to 2 are grad2d's, quad 3 is the normal's (AUX). A workgroup
// of 64 threads owns 16 consecutive visible splats in index order.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint AUX = 0u;
layout(constant_id = 23) const uint PER_TURN = 8u;  // slots per turn of the loop
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Listed { uint listed[]; };
layout(set = 0, binding = 2) readonly buffer SlotOffsets { uint slot_offsets[]; };
layout(set = 0, binding = 3) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 4) readonly buffer SlotGrads { vec4 slot_grads[]; };
layout(set = 0, binding = 5) readonly buffer SlotNormals { vec4 slot_normals[]; };
layout(set = 0, binding = 6) writeonly buffer Grad2d { vec4 grad2d[]; };
layout(set = 0, binding = 7) writeonly buffer GradNormals { vec4 grad_normals[]; };

void main() {
    const uint k = global_index() / 4u;
    const uint quad = global_index() % 4u;
    if (k >= counters[COUNTER_VISIBLE] || (AUX == 0u && quad == 3u)) return;
    const uint splat = listed[k];
    const uint begin = slot_offsets[splat];
    const uint end = begin + tile_counts[splat];
    vec4 sum = vec4(0.0);
    // A visible splat has at least one slot. The loop tests at its end, see common.glsl.
    uint slot = begin;
    do {
        for (uint i = 0u; i < PER_TURN; ++i) {
            if (slot + i < end) {
                if (AUX != 0u && quad == 3u) sum.xyz += LOAD4(slot_normals, slot + i).xyz;
                else sum += LOAD4(slot_grads, 3u * (slot + i) + quad);
            }
        }
        slot += PER_TURN;
    } while (slot < end);
    if (AUX != 0u && quad == 3u) grad_normals[splat] = sum;
    else grad2d[3u * splat + quad] = sum;
}
