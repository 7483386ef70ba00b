#version 460
// emit: writes the tiles of each visible splat, in depth order, as (tile, slot) pairs.
// One thread owns one visible splat and its slots [pair_offsets[k], + tile_counts[splat]); a workgroup owns 64 consecutive ones.
// The tiles come from the same code on the same bits as the counts. Should a compiler make them differ all the same, a thread
// writes no slot that is not its own, and fills what it has left with the number after the last tile, which no tile's list holds.
#extension GL_EXT_control_flow_attributes : require
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

void main() {
    const uint k = global_index();
    if (k >= counters[COUNTER_VISIBLE]) return;
    const uint splat = order[k];
    uint slot = min(pair_offsets[k], push.capacity);
    const uint end = slot + min(tile_counts[splat], push.capacity - slot);
    const TileGrid grid = TileGrid(uvec2(push.width, push.height), uvec2(push.tile_width, push.tile_height));
    const uvec2 tiles = tile_counts_of(grid);
    const vec4 p = LOAD4(splat2d, 3u * splat);
    const vec4 q = LOAD4(splat2d, 3u * splat + 1u);
    const TileEllipse e = tile_ellipse(p.xy, vec3(p.zw, q.x), q.y, grid);
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
