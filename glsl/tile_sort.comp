#version 460
//! variant subgroup
//! variant emulated SUBGROUP_EMULATED
// tile_sort: puts the pairs of each tile in the order of (depth, slot), with CARRIED of (depth, splat): of equal depths
// the lower splat is in front. Writes the splat, and without CARRIED the slot, of each pair in that order, and the
// tile's range, which is (0, 0) where it is empty. A workgroup owns a tile.
//
// A bitonic sort whose comparisons all put the lower in front (Batcher 1968, with the first step of each merge mirrored),
// so that the length need not be a power of two: places behind the end count as highest, and never move. Lists of up to
// CAPACITY pairs lie in shared memory. Longer ones are sorted in parts of CAPACITY; then steps over longer distances
// work on the list itself, and all shorter ones on parts in shared memory.
#extension GL_GOOGLE_include_directive : require
#define LOCAL_SIZE 256
#include "subgroup.glsl"
#include "common.glsl"
#include "tile_edges.glsl"
layout(local_size_x = LOCAL_SIZE) in;
layout(constant_id = 0) const uint CARRIED = 0u;  // pairs carry the splat itself, and there are no slots
layout(constant_id = 1) const uint CAPACITY = 2048u;  // a power of two
layout(set = 0, binding = 0) coherent buffer Pairs { uvec2 pairs[]; };
layout(set = 0, binding = 1) readonly buffer TileFirst { uint tile_first[]; };
layout(set = 0, binding = 2) readonly buffer SlotSplat { uint slot_splat[]; };  // not where CARRIED
layout(set = 0, binding = 3) writeonly buffer SortedSplats { uint sorted_splats[]; };
layout(set = 0, binding = 4) writeonly buffer SortedSlots { uint sorted_slots[]; };  // not where CARRIED
layout(set = 0, binding = 5) buffer TileRanges { uvec2 tile_ranges[]; };
layout(push_constant) uniform Push {
    uint columns;  // of tiles
    uint rows;
} push;

shared uvec2 staged[CAPACITY];

bool is_behind(uvec2 a, uvec2 b) { return a.x > b.x || (a.x == b.x && a.y > b.y); }

// The two places that comparison t of a step looks at. A step of `log_span` s compares within blocks of 2^s places:
// mirrored, the first with the last, or else each with the one half a block behind.
uvec2 compared(uint t, uint log_span, bool mirrored) {
    const uint log_half = log_span - 1u;
    const uint within = t & ((1u << log_half) - 1u);
    const uint block = t >> log_half << log_span;
    return block + uvec2(within, mirrored ? (1u << log_span) - 1u - within : within + (1u << log_half));
}

void step_in_shared(uint n, uint comparisons, uint log_span, bool mirrored) {
    for (uint t = workgroup_rank(); t < comparisons; t += LOCAL_SIZE) {
        const uvec2 at = compared(t, log_span, mirrored);
        if (at.y < n) {
            const uvec2 a = staged[at.x];
            const uvec2 b = staged[at.y];
            if (is_behind(a, b)) {
                staged[at.x] = b;
                staged[at.y] = a;
            }
        }
    }
}

void step_in_list(uint begin, uint n, uint comparisons, uint log_span, bool mirrored) {
    for (uint t = workgroup_rank(); t < comparisons; t += LOCAL_SIZE) {
        const uvec2 at = compared(t, log_span, mirrored);
        if (at.y < n) {
            const uvec2 a = pairs[begin + at.x];
            const uvec2 b = pairs[begin + at.y];
            if (is_behind(a, b)) {
                pairs[begin + at.x] = b;
                pairs[begin + at.y] = a;
            }
        }
    }
}

// Between two steps. Within blocks of twice its width a subgroup compares only what it wrote itself.
void meet(uint log_span) {
    if (1u << log_span <= 2u * subgroup_width()) subgroup_meet();
    else barrier();
}

// The steps of merges `first` to `last` of `n` staged pairs; a merge k makes ordered blocks of 2^k. `mirrored`: with the
// first step of merge `first`.
void merge_in_shared(uint n, uint first, uint last, bool mirrored) {
    barrier();
    for (uint k = first; k < last + 1u; ++k) {
        for (uint j = 0u; j < k; ++j) {
            meet(j == 0u ? k : k - j + 1u);
            step_in_shared(n, 1u << (last - 1u), k - j, j == 0u && (mirrored || k > first));
        }
    }
    barrier();
}

void stage(uint begin, uint n) {
    for (uint i = local_index(); i < n; i += LOCAL_SIZE) staged[i] = pairs[begin + i];
}

void meet_in_list() {
    memoryBarrierBuffer();
    barrier();
}

// Logarithm to the base 2, rounded up.
uint log_of(uint n) { return n < 2u ? 0u : uint(findMSB(n - 1u)) + 1u; }

// Orders a list in its place.
void sort_long(uint begin, uint n) {
    const uint log_part = log_of(CAPACITY);
    for (uint k = log_part; k < log_of(n) + 1u; ++k) {
        for (uint j = 0u; j < k - log_part; ++j) {
            step_in_list(begin, n, 1u << (log_of(n) - 1u), k - j, j == 0u);
            meet_in_list();
        }
        for (uint part = 0u; part < n; part += CAPACITY) {
            const uint length = min(CAPACITY, n - part);
            stage(begin + part, length);
            merge_in_shared(length, k > log_part ? log_part : 1u, log_part, k == log_part);
            for (uint i = local_index(); i < length; i += LOCAL_SIZE) pairs[begin + part + i] = staged[i];
            meet_in_list();
        }
    }
}

void main() {
    const uint tile = group_index();
    const bool real = tile < push.columns * push.rows;
    const uvec2 range = real ? tile_ranges[tile] : uvec2(0u);
    const uint edge = real ? edge_at(uvec2(tile % push.columns, tile / push.columns), uvec2(push.columns, push.rows)) : 0u;
    const uint n = min(range.y, tile_first[edge + 1u]) - range.x;
    const bool is_long = n > CAPACITY;
    if (is_long) {
        sort_long(range.x, n);
    } else if (n > 0u) {
        stage(range.x, n);
        if (n > 1u) merge_in_shared(n, 1u, log_of(n), true);
        else barrier();
    }
    for (uint i = local_index(); i < n; i += LOCAL_SIZE) {
        uvec2 pair;
        if (is_long) pair = pairs[range.x + i];
        else pair = staged[i];
        if (CARRIED == 0u) sorted_slots[range.x + i] = pair.y;
        sorted_splats[range.x + i] = CARRIED != 0u ? pair.y : slot_splat[pair.y];
    }
    if (real && local_index() == 0u) tile_ranges[tile] = n > 0u ? uvec2(range.x, range.x + n) : uvec2(0u);
}
