#version 460
// densify_gather: one plane after a density change, from a copy of it before. Words are moved as bits.
// One thread owns one new row of WIDTH words; one workgroup owns 64 consecutive rows.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "densify.glsl"
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint WIDTH = 1u;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Map { uint map[]; };
layout(set = 0, binding = 2) readonly buffer Source { uint source[]; };
layout(set = 0, binding = 3) writeonly buffer Plane { uint plane[]; };
layout(push_constant) uniform Push { uint mode; } push;

const uint MODE_COPY = 0u;    // every row as its source
const uint MODE_SHRINK = 1u;  // logarithmic scales: children of a split are smaller
const uint MODE_MOMENT = 2u;  // moments: zero for rows that are new
const uint MODE_ZERO = 3u;    // statistics: zero for all

void main() {
    const uint row = global_index();
    if (row >= counters[COUNTER_SCAN_TOTAL]) return;
    const uint entry = map[row];
    const uint i = map_source(entry);
    const uint kind = map_kind(entry);
    const bool zero = push.mode == MODE_ZERO || (push.mode == MODE_MOMENT && kind != KIND_KEPT);
    const bool shrink = push.mode == MODE_SHRINK && (kind == KIND_CHILD_A || kind == KIND_CHILD_B);
    for (uint k = 0u; k < WIDTH; ++k) {
        uint word = source[WIDTH * i + k];
        if (shrink) word = floatBitsToUint(uintBitsToFloat(word) - LN_SPLIT_SHRINK);
        plane[WIDTH * row + k] = zero ? 0u : word;
    }
}
