// Shared by the variants of emission: bindings, the place of a pair, and the loop of one thread over a splat's tiles.
// Places are in depth order, which the sort keeps. Slots are in the order of splats, so that the slots of neighbouring
// splats are close in memory for the sums.
#ifndef EMIT_GLSL
#define EMIT_GLSL

#extension GL_EXT_control_flow_attributes : require
#include "common.glsl"
#include "counters.glsl"
#include "loads.glsl"
#include "tile.glsl"

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

TileGrid tile_grid() { return TileGrid(uvec2(push.width, push.height), uvec2(push.tile_width, push.tile_height)); }

TileEllipse ellipse_of(uint splat) {
    const vec4 p = LOAD4(splat2d, 3u * splat);
    const vec4 q = LOAD4(splat2d, 3u * splat + 1u);
    return tile_ellipse(p.xy, vec3(p.zw, q.x), q.y, tile_grid());
}

// The places of visible splat k: one per tile, as many as fit (with slots).
uvec2 places_of(uint k, uint splat) {
    uint room = room_from(pair_offsets[k]);
    if (CARRIED == 0u) room = min(room, room_from(slot_offsets[splat]));
    return uvec2(pair_offsets[k], pair_offsets[k] + min(tile_counts[splat], room));
}

// Writes all pairs of a splat with at least one pair. A single loop over the tiles, row after row: threads in lockstep
// wait for the most tiles, not for the most rows times the most columns. The loop tests at its end, see common.glsl.
void emit_alone(uint splat, uint place, uint end, uint shift) {
    const TileGrid grid = tile_grid();
    const uvec2 tiles = tile_counts_of(grid);
    const TileEllipse e = ellipse_of(splat);
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

#endif
