#version 460
// emit: writes the tiles of each visible splat, in depth order, as (tile, slot) pairs.
// One thread owns one visible splat and its slots [pair_offsets[k], + tile_counts[splat]); a workgroup owns 64 consecutive ones.
// The tiles come from the same code on the same bits as the counts. Should a compiler make them differ all the same, a thread
// writes no slot that is not its own, and fills what it has left with the number after the last tile, which no tile's list holds.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "emit.glsl"
layout(local_size_x = 64) in;

void main() {
    const uint k = global_index();
    if (k >= counters[COUNTER_VISIBLE]) return;
    const uint splat = order[k];
    const uvec2 slots = slots_of(k, splat);
    if (slots.x < slots.y) emit_alone(splat, slots.x, slots.y);
}
