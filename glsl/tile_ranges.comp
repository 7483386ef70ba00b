#version 460
// tile_ranges: the range of each tile in the sorted pairs, and the splat of each sorted pair (not with CARRIED). One
// thread owns one sorted pair, and the bound of a tile's range where the tile changes; a workgroup owns 64 consecutive
// pairs. `tile_ranges` is zero beforehand, so a tile without pairs keeps an empty range.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint CARRIED = 0u;  // 1: the pairs carry the splats themselves, already sorted
layout(set = 0, binding = 0) readonly buffer PairKeys { uint pair_keys[]; };
layout(set = 0, binding = 1) readonly buffer PairVals { uint pair_vals[]; };
layout(set = 0, binding = 2) readonly buffer SlotSplat { uint slot_splat[]; };
layout(set = 0, binding = 3) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 4) writeonly buffer SortedSplats { uint sorted_splats[]; };
layout(set = 0, binding = 5) writeonly buffer TileRanges { uvec2 tile_ranges[]; };
layout(push_constant) uniform Push { uint tiles; } push;
void main() {
    const uint j = global_index();
    const uint pairs = counters[COUNTER_PAIRS];
    if (j >= pairs) return;
    const uint tile = pair_keys[j];
    if (CARRIED == 0u) sorted_splats[j] = slot_splat[pair_vals[j]];
    if (tile >= push.tiles) return;
    if (j == 0u || pair_keys[j - 1u] != tile) tile_ranges[tile].x = j;
    if (j + 1u == pairs || pair_keys[j + 1u] != tile) tile_ranges[tile].y = j + 1u;
}
