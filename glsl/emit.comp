#version 460
// emit: writes the tiles of each visible splat, in depth order, as pairs of a tile and a slot (with CARRIED, of a tile
// and the splat). One thread owns one visible splat, its places [pair_offsets[k], + tile_counts[splat]) and its slots
// [slot_offsets[splat], + as many); a workgroup owns 64 consecutive ones in depth order. The tiles come from the same
// code on the same bits as the counts. If a compiler still makes the two differ, a thread writes only its own places,
// and fills unused places with the number after the last tile, which is in no tile's list.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "loads.glsl"
#include "tile.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 1) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 2) readonly buffer Order { uint order[]; };
layout(set = 0, binding = 3) readonly buffer PairOffsets { uint pair_offsets[]; };
layout(set = 0, binding = 4) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 5) writeonly buffer PairKeys { uint pair_keys[]; };
layout(set = 0, binding = 6) writeonly buffer PairVals { uint pair_vals[]; };
layout(set = 0, binding = 7) writeonly buffer SlotSplat { uint slot_splat[]; };          // not where CARRIED
layout(set = 0, binding = 8) readonly buffer SlotOffsets { uint slot_offsets[]; };  // not where CARRIED
layout(push_constant) uniform Push {
    uint width;
    uint height;
    uint tile_width;
    uint tile_height;
    uint capacity;  // pairs that fit
} push;

layout(constant_id = 0) const uint CARRIED = 0u;  // pairs carry the splat itself, and there are no slots
// Tiles per turn of the loop.
layout(constant_id = 23) const uint PER_TURN = 8u;

// Writes a pair to a place; place + `shift` is the pair's slot.
void store_pair(uint place, uint shift, uint tile, uint splat) {
    pair_keys[place] = tile;
    if (CARRIED != 0u) {
        pair_vals[place] = splat;
    } else {
        pair_vals[place] = place + shift;
        slot_splat[place + shift] = splat;
    }
}

// Offset from the first place of visible splat k to its first slot.
uint shift_of(uint k, uint splat) { return CARRIED != 0u ? 0u : slot_offsets[splat] - pair_offsets[k]; }

// Number of places or slots that fit from a first place or slot on.
uint room_from(uint first) { return push.capacity - min(first, push.capacity); }

// The places of visible splat k: one per tile, as many as fit (with slots).
uvec2 places_of(uint k, uint splat) {
    uint room = room_from(pair_offsets[k]);
    if (CARRIED == 0u) room = min(room, room_from(slot_offsets[splat]));
    return uvec2(pair_offsets[k], pair_offsets[k] + min(tile_counts[splat], room));
}

// Writes all pairs of a splat with at least one pair. A single loop over the tiles, row after row: threads in lockstep
// wait for the most tiles, not for the most rows times the most columns. The loop tests at its end, see common.glsl.
void emit_all(uint splat, uint place, uint end, uint shift) {
    const TileGrid grid = TileGrid(uvec2(push.width, push.height), uvec2(push.tile_width, push.tile_height));
    const uvec2 tiles = tile_counts_of(grid);
    const TileEllipse e = ellipse_of(LOAD4(splat2d, 3u * splat), LOAD4(splat2d, 3u * splat + 1u), grid);
    const uint steps = end - place + (e.row_end - e.row_begin);  // a turn per place, and per row without tiles
    uint step = 0u;
    uint y = e.row_begin;
    uvec2 columns = tile_row(e, y, grid);  // the rest of the row
    do {
        for (uint j = 0u; j < PER_TURN; ++j) {
            const bool listed = y < e.row_end;
            if (place < end && (!listed || columns.x < columns.y)) {
                store_pair(place, shift, listed ? y * tiles.x + columns.x : tiles.x * tiles.y, splat);
                ++place;
                ++columns.x;
            }
            if (columns.x >= columns.y) columns = tile_row(e, ++y, grid);
        }
        step += PER_TURN;
    } while (step < steps && place < end);
}

void main() {
    const uint k = global_index();
    if (k >= counters[COUNTER_VISIBLE]) return;
    const uint splat = order[k];
    const uvec2 places = places_of(k, splat);
    if (places.x < places.y) emit_all(splat, places.x, places.y, shift_of(k, splat));
}
