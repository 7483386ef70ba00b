#version 460
// emit: writes the tiles of each visible splat, in depth order, as pairs of a tile and a slot (with CARRIED, of a tile
// and the splat). One thread owns one visible splat, its places [pair_offsets[k], + tile_counts[splat]) and its slots
// [slot_offsets[splat], + as many); a workgroup owns 64 consecutive ones in depth order. The tiles come from the same
// code on the same bits as the counts. If a compiler still makes the two differ, a thread writes only its own places,
// and fills unused places with the number after the last tile, which is in no tile's list.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "emit.glsl"
layout(local_size_x = 64) in;

void main() {
    const uint k = global_index();
    if (k >= counters[COUNTER_VISIBLE]) return;
    const uint splat = order[k];
    const uvec2 places = places_of(k, splat);
    if (places.x < places.y) emit_alone(splat, places.x, places.y, shift_of(k, splat));
}
