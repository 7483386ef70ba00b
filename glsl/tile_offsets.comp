#version 460
//! variant subgroup
//! variant emulated SUBGROUP_EMULATED
// tile_offsets: the first pair of each tile, from the edges of tile_edges. The sums of the words up to each word are the
// numbers of pairs of the tiles (0 behind a row); the sums of the numbers before are the first pairs, which take the
// place of the edges. So `edges` ends as `tile_first`: the word behind a tile's is the end of its pairs. Each tile's
// range begins empty at its first pair. Counters get the visible splats and the pairs; a number of pairs that
// overflows becomes the largest word. When the pairs do not fit, or `status` is already set, the event is void: the
// first `void_entries` entries of `args` become zero, so that no later pass runs on incomplete lists. Otherwise two
// entries get the workgroups of passes over the visible splats. One workgroup walks over the words; in each turn a
// thread owns ITEMS of them.
#extension GL_GOOGLE_include_directive : require
#define LOCAL_SIZE 256
#include "subgroup.glsl"
#include "workgroup_sum.glsl"
#include "common.glsl"
#include "count.glsl"
#include "counters.glsl"
layout(local_size_x = LOCAL_SIZE) in;
layout(constant_id = 0) const uint ITEMS = 8u;
layout(set = 0, binding = 0) buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) buffer Edges { uint edges[]; };
layout(set = 0, binding = 2) writeonly buffer TileRanges { uvec2 tile_ranges[]; };
layout(set = 0, binding = 3) writeonly buffer Args { uvec4 args[]; };
layout(push_constant) uniform Push {
    uint columns;  // of tiles
    uint rows;
    uint capacity;      // most pairs
    uint void_entries;  // of args
    uint first;         // entry of args for passes over the visible splats; the next one is for slot_sum
    uint per_group;     // visible splats of a workgroup of the former
    uint per_sum;       // and of the latter
} push;

shared uint passed;  // nonzero: the number of pairs has overflowed

void main() {
    if (local_index() == 0u) passed = 0u;
    barrier();
    // Only one workgroup is expected; further workgroups do nothing.
    const bool owner = group_index() == 0u;
    const uint status = counters[COUNTER_STATUS];
    const uint words = owner && status == 0u ? (push.columns + 1u) * push.rows : 0u;
    uint here = 0u;   // pairs of the tile before this turn's words
    uint pairs = 0u;  // pairs of all tiles before
    bool over = false;
    for (uint from = 0u; from < words; from += LOCAL_SIZE * ITEMS) {
        const uint begin = min(from + workgroup_rank() * ITEMS, words);
        const uint end = min(begin + ITEMS, words);
        uint sum = 0u;
        for (uint i = begin; i < end; ++i) sum += edges[i];
        uint total;
        const uint before = here + workgroup_exclusive_add(sum, total);
        here += total;
        uint count = before;
        sum = 0u;
        for (uint i = begin; i < end; ++i) {
            count += edges[i];
            sum += count;
        }
        uint first = pairs + workgroup_exclusive_add(sum, total);
        pairs += total;
        count = before;
        for (uint i = begin; i < end; ++i) {
            count += edges[i];
            edges[i] = first;
            const uint column = i % (push.columns + 1u);
            if (column < push.columns) tile_ranges[i / (push.columns + 1u) * push.columns + column] = uvec2(first);
            first += count;
            over = over || first < count;
        }
    }
    if (over) atomicOr(passed, 1u);
    barrier();
    if (!owner || local_index() != 0u) return;
    bool fits = status == 0u;
    if (fits) {
        if (passed != 0u) pairs = 0xffffffffu;
        counters[COUNTER_VISIBLE] = edges[(push.columns + 1u) * push.rows];
        counters[COUNTER_PAIRS] = pairs;
        counters[COUNTER_WANT_PAIRS] = max(counters[COUNTER_WANT_PAIRS], pairs);
        fits = pairs <= push.capacity;
        if (!fits) counters[COUNTER_STATUS] = STATUS_PAIRS;
    }
    const uint voided = fits ? 0u : push.void_entries;
    for (uint i = 0u; i < voided; ++i) args[i] = uvec4(0u);
    if (!fits) return;
    const uint visible = counters[COUNTER_VISIBLE];
    args[push.first] = entry_of(table_size(visible, push.per_group, 1u));
    args[push.first + 1u] = entry_of(table_size(visible, push.per_sum, 1u));
}
