// What the forms of emission share: bindings, the place of a pair, and a splat whose tiles one thread writes.
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
layout(set = 0, binding = 7) writeonly buffer SlotSplat { uint slot_splat[]; };
layout(push_constant) uniform Push {
    uint width;
    uint height;
    uint tile_width;
    uint tile_height;
    uint capacity;  // pairs that fit
} push;

// Tiles a turn of the loop.
layout(constant_id = 23) const uint PER_TURN = 8u;

void put(uint slot, uint tile, uint splat) {
    pair_keys[slot] = tile;
    pair_vals[slot] = slot;
    slot_splat[slot] = splat;
}

TileGrid tile_grid() { return TileGrid(uvec2(push.width, push.height), uvec2(push.tile_width, push.tile_height)); }

TileEllipse ellipse_of(uint splat) {
    const vec4 p = LOAD4(splat2d, 3u * splat);
    const vec4 q = LOAD4(splat2d, 3u * splat + 1u);
    return tile_ellipse(p.xy, vec3(p.zw, q.x), q.y, tile_grid());
}

// The slots of visible splat k: as many as it has tiles, and as fit.
uvec2 slots_of(uint k, uint splat) {
    const uint slot = min(pair_offsets[k], push.capacity);
    return uvec2(slot, slot + min(tile_counts[splat], push.capacity - slot));
}

// Writes all pairs of a splat that has any. One loop over its tiles, row after row: threads that go together wait for the one with the
// most tiles, not for the most rows times the most columns. It tests at its end, see common.glsl.
void emit_alone(uint splat, uint slot, uint end) {
    const TileGrid grid = tile_grid();
    const uvec2 tiles = tile_counts_of(grid);
    const TileEllipse e = ellipse_of(splat);
    const uint steps = end - slot + (e.row_end - e.row_begin);  // a slot each, and rows that list no tile
    uint step = 0u;
    uint y = e.row_begin;
    uvec2 columns = tile_row(e, y, grid);  // what is left of the row
    while (true) {
        for (uint j = 0u; j < PER_TURN; ++j) {
            const bool listed = y < e.row_end;
            if (slot < end && (!listed || columns.x < columns.y)) {
                put(slot, listed ? y * tiles.x + columns.x : tiles.x * tiles.y, splat);
                ++slot;
                ++columns.x;
            }
            if (columns.x >= columns.y) columns = tile_row(e, ++y, grid);
        }
        step += PER_TURN;
        if (step >= steps || slot >= end) break;
    }
}

#endif
