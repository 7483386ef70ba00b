#version 460
// emit_together: same results as emit, for wide subgroups, where one splat with many tiles would make the whole
// subgroup wait. One thread owns one visible splat with its places and slots, a workgroup 64 consecutive ones. The
// subgroup shares a splat of LARGE places or more: each lane takes a row of tiles, a prefix sum over the rows gives the
// places of each row's pairs, and then lanes take the pairs in turn, so that the stores of a subgroup are contiguous.
//! variant subgroup
//! variant emulated SUBGROUP_EMULATED
#extension GL_GOOGLE_include_directive : require
#define LOCAL_SIZE 64
#include "subgroup.glsl"
#include "emit.glsl"
layout(local_size_x = LOCAL_SIZE) in;

const uint LARGE = 32u;

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

// Writes the pairs of a splat that all lanes of the subgroup name; none where place = end.
void emit_shared(uint splat, uint place, uint end, uint shift) {
    const TileGrid grid = tile_grid();
    const uvec2 tiles = tile_counts_of(grid);
    const uint width = subgroup_width();
    const uint lane = subgroup_lane();
    TileEllipse e = ellipse_of(splat);
    if (place == end) e.row_end = e.row_begin;
    const uint row_turns = common_turns(e.row_end - e.row_begin);
    for (uint y0 = 0u; y0 < row_turns; y0 += width) {
        const uint y = e.row_begin + y0 + lane;
        uvec2 columns = uvec2(0u);
        if (y < e.row_end) columns = tile_row(e, y, grid);
        const uint count = columns.y - columns.x;
        const uint before = subgroup_exclusive_add(count);
        const uint total = subgroup_broadcast(before + count, width - 1u);
        const uint turns = common_turns(total);
        for (uint j0 = 0u; j0 < turns; j0 += width) {
            const uint j = j0 + lane;
            const uint row = last_at_most(before, j);
            const uint x = subgroup_shuffle(columns.x, row) + (j - subgroup_shuffle(before, row));
            if (j < total && place + j < end) store_pair(place + j, shift, (e.row_begin + y0 + row) * tiles.x + x, splat);
        }
        place += total;
    }
    for (uint left = place + lane; left < end; left += width) store_pair(left, shift, tiles.x * tiles.y, splat);
}

void main() {
    const uint k = global_index();
    uint splat = 0u;
    uvec2 places = uvec2(0u);
    uint shift = 0u;
    if (k < counters[COUNTER_VISIBLE]) {
        splat = order[k];
        places = places_of(k, splat);
        shift = shift_of(k, splat);
    }
    const bool large = places.y - places.x >= LARGE;
    if (!large && places.y > places.x) emit_alone(splat, places.x, places.y, shift);
#ifdef SUBGROUP_EMULATED
    for (uint lane = 0u; lane < subgroup_width(); ++lane) {
        const bool shared_now = subgroup_broadcast(uint(large), lane) != 0u;
        const uint from = subgroup_broadcast(places.x, lane);
        const uint to = subgroup_broadcast(places.y, lane);
        emit_shared(subgroup_broadcast(splat, lane), from, shared_now ? to : from, subgroup_broadcast(shift, lane));
    }
#else
    const uvec4 ballot = subgroup_ballot(large);
    for (uint word = 0u; word < 4u; ++word) {
        for (uint bits = ballot[word]; bits > 0u; bits -= bits & (~bits + 1u)) {
            const uint lane = 32u * word + uint(findLSB(bits));
            const uint from = subgroup_broadcast(places.x, lane);
            const uint to = subgroup_broadcast(places.y, lane);
            emit_shared(subgroup_broadcast(splat, lane), from, to, subgroup_broadcast(shift, lane));
        }
    }
#endif
}
