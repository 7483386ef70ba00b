#version 460
//! variant subgroup
//! variant emulated SUBGROUP_EMULATED
//! texels
// emit_tiles: writes each (splat, tile) pair to a free place of its tile's list, as the depth and the slot (with
// CARRIED, the splat). The places of a list are given out by an atomic addition, so their order changes from run to
// run; tile_sort puts a list in order. One thread owns one splat, a workgroup 64 consecutive splats. The subgroup
// shares the rows of tiles of all its splats, a row a lane, and then the pairs of these rows, a pair a lane, so that no
// lane waits for a splat with many tiles. Slots lie in the order of the splats, a splat's in the order of its tiles.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#define LOCAL_SIZE 64
#include "subgroup.glsl"
#include "common.glsl"
#include "counters.glsl"
#include "loads.glsl"
#include "tile.glsl"
#include "tile_edges.glsl"
layout(local_size_x = LOCAL_SIZE) in;
layout(set = 0, binding = 0) readonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 1) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 2) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 3) readonly buffer TileFirst { uint tile_first[]; };
layout(set = 0, binding = 4) buffer TileRanges { uint tile_ranges[]; };
layout(set = 0, binding = 5) writeonly buffer Pairs { uvec2 pairs[]; };
layout(set = 0, binding = 6) writeonly buffer SlotSplat { uint slot_splat[]; };     // not where CARRIED
layout(set = 0, binding = 7) readonly buffer SlotOffsets { uint slot_offsets[]; };  // not where CARRIED
layout(push_constant) uniform Push {
    uint width;
    uint height;
    uint tile_width;
    uint tile_height;
    uint shift;     // low bits of a depth to drop
    uint capacity;  // slots that fit
} push;

layout(constant_id = 0) const uint CARRIED = 0u;  // pairs carry the splat itself, and there are no slots

// Turns of a loop with subgroup operations: the turns that this subgroup needs; with emulated operations, which have
// workgroup barriers, the most that any subgroup needs.
#ifdef SUBGROUP_EMULATED
shared uint most_turns;
uint common_turns(uint turns) {
    if (local_index() == 0u) most_turns = 0u;
    barrier();
    atomicMax(most_turns, turns);
    barrier();
    const uint most = most_turns;
    barrier();
    return most;
}
#else
uint common_turns(uint turns) { return turns; }
#endif

// The last lane whose `before`, ascending over the lanes from 0 on, is at most j. Called by all lanes.
uint last_at_most(uint before, uint j) {
    uint found = 0u;
    [[unroll]] for (uint k = 0u; k < 7u; ++k) {
        const uint bit = 64u >> k;
        if (bit < subgroup_width() && subgroup_shuffle(before, found + bit) <= j) found += bit;
    }
    return found;
}

TileEllipse ellipse_from(TileEllipse e, uint lane) {
    e.mean = vec2(subgroup_shuffle(e.mean.x, lane), subgroup_shuffle(e.mean.y, lane));
    e.inv_a = subgroup_shuffle(e.inv_a, lane);
    e.b = subgroup_shuffle(e.b, lane);
    e.a_t = subgroup_shuffle(e.a_t, lane);
    e.det = subgroup_shuffle(e.det, lane);
    e.extent_y = subgroup_shuffle(e.extent_y, lane);
    e.top_y = subgroup_shuffle(e.top_y, lane);
    e.row_begin = subgroup_shuffle(e.row_begin, lane);
    return e;
}

void main() {
    const TileGrid grid = TileGrid(uvec2(push.width, push.height), uvec2(push.tile_width, push.tile_height));
    const uvec2 tiles = tile_counts_of(grid);
    const uint width = subgroup_width();
    const uint lane = subgroup_lane();
    const uint splat = global_index();
    const uint count = splat < counters[COUNTER_SPLATS] ? tile_counts[splat] : 0u;
    TileEllipse e = tile_ellipse(vec2(0.0), vec3(0.0), 0.0, grid);
    uint depth = 0u;
    uint slot = 0u;
    if (count > 0u) {
        const vec4 q = LOAD4(splat2d, 3u * splat + 1u);
        e = ellipse_of(LOAD4(splat2d, 3u * splat), q, grid);
        depth = floatBitsToUint(q.z) >> push.shift;
        if (CARRIED == 0u) slot = slot_offsets[splat];
    }
    const uint rows = e.row_end - e.row_begin;
    const uint rows_before = subgroup_exclusive_add(rows);
    const uint all_rows = subgroup_broadcast(rows_before + rows, width - 1u);
    const uint pairs_before = subgroup_exclusive_add(count);
    uint done = 0u;  // pairs of the rows of earlier turns
    const uint row_turns = common_turns(all_rows);
    for (uint from = 0u; from < row_turns; from += width) {
        const uint owner = last_at_most(rows_before, from + lane);
        const TileEllipse own = ellipse_from(e, owner);
        const uint y = own.row_begin + from + lane - subgroup_shuffle(rows_before, owner);
        uvec2 columns = uvec2(0u);
        if (from + lane < all_rows) columns = tile_row(own, y, grid);
        const uint length = columns.y - columns.x;
        const uint before = subgroup_exclusive_add(length);
        const uint all = subgroup_broadcast(before + length, width - 1u);
        const uint turns = common_turns(all);
        for (uint first = 0u; first < turns; first += width) {
            const uint j = first + lane;
            const uint row = last_at_most(before, j);
            const uvec2 at = uvec2(subgroup_shuffle(columns.x, row) + j - subgroup_shuffle(before, row), subgroup_shuffle(y, row));
            const uint of = subgroup_shuffle(owner, row);
            const uint of_splat = subgroup_shuffle(splat, of);
            const uint nth = done + j - subgroup_shuffle(pairs_before, of);
            const uint own_slot = subgroup_shuffle(slot, of) + nth;
            const uint own_depth = subgroup_shuffle(depth, of);
            // Tiles are those that were counted, by the same code on the same bits. If a compiler still makes the two
            // differ, nothing is written beyond the places and slots that were counted.
            const bool counted = nth < subgroup_shuffle(count, of) && (CARRIED != 0u || own_slot < push.capacity);
            if (j < all && counted) {
                const uint edge = edge_at(at, tiles);
                const uint place = atomicAdd(tile_ranges[2u * (at.y * tiles.x + at.x) + 1u], 1u);
                if (place < tile_first[edge + 1u]) pairs[place] = uvec2(own_depth, CARRIED != 0u ? of_splat : own_slot);
                if (CARRIED == 0u) slot_splat[own_slot] = of_splat;
            }
        }
        done += all;
    }
}
