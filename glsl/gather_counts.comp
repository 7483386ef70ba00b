#version 460
// gather_counts: the tile counts of the visible splats in depth order.
// One thread owns one visible splat; a workgroup owns 64 consecutive ones.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Order { uint order[]; };
layout(set = 0, binding = 1) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 2) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 3) writeonly buffer Counts { uint counts[]; };
void main() {
    const uint k = global_index();
    if (k < counters[COUNTER_VISIBLE]) counts[k] = tile_counts[order[k]];
}
