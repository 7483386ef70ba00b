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

// Tiles per turn of a loop: lavapipe silently ends all loops of a thread after 65,535 turns in total, and a splat that covers a
// picture of 3840x2160 has 129,600 tiles of 8x8.
const uint STRIDE = 8u;

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

// Writes all pairs of a splat.
void emit_alone(uint splat, uint slot, uint end) {
    const TileGrid grid = tile_grid();
    const uvec2 tiles = tile_counts_of(grid);
    const TileEllipse e = ellipse_of(splat);
    for (uint y = e.row_begin; y < e.row_end; ++y) {
        const uvec2 columns = tile_row(e, y, grid);
        for (uint x = columns.x; x < columns.y; x += STRIDE) {
            [[unroll]] for (uint j = 0u; j < STRIDE; ++j) {
                if (x + j < columns.y && slot < end) put(slot++, y * tiles.x + x + j, splat);
            }
        }
    }
    for (; slot < end; slot += STRIDE) {
        [[unroll]] for (uint j = 0u; j < STRIDE; ++j) {
            if (slot + j < end) put(slot + j, tiles.x * tiles.y, splat);
        }
    }
}

#endif
