#version 460
//! variant subgroup
//! variant emulated SUBGROUP_EMULATED
// scan_add: third pass of a prefix sum: every word's exclusive prefix within its workgroup plus the workgroup's base.
// One thread owns ITEMS consecutive words, a workgroup 64 * ITEMS.
#extension GL_GOOGLE_include_directive : require
#define LOCAL_SIZE 64
#include "subgroup.glsl"
#include "workgroup_sum.glsl"
#include "common.glsl"
#include "count.glsl"
layout(local_size_x = LOCAL_SIZE) in;
layout(constant_id = 0) const uint ITEMS = 16u;
layout(set = 0, binding = 0) readonly buffer Source { uint words[]; };
layout(set = 0, binding = 1) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 2) readonly buffer Sums { uint sums[]; };
layout(set = 0, binding = 3) writeonly buffer Target { uint target[]; };
layout(push_constant) uniform Push {
    uint source;     // counter that holds the count, or NO_COUNTER
    uint count;      // the count when there is no counter
    uint divide;     // elements: table_size(count, divide, multiply)
    uint multiply;
    uint predicate;  // not 0: sum 1 for every word that is not 0
    uint total;      // counter that gets the sum, or NO_COUNTER (spine)
} push;
void main() {
    const uint given = push.source == NO_COUNTER ? push.count : counters[push.source];
    const uint n = table_size(given, push.divide, push.multiply);
    const uint group = group_index();
    const uint first = (group * LOCAL_SIZE + workgroup_rank()) * ITEMS;
    const uint end = min(first + ITEMS, n);
    uint sum = 0u;
    for (uint i = first; i < end; ++i) {
        const uint word = words[i];
        sum += push.predicate != 0u ? uint(word != 0u) : word;
    }
    uint total;
    uint running = workgroup_exclusive_add(sum, total);
    if (first < end) running += sums[group];
    for (uint i = first; i < end; ++i) {
        const uint word = words[i];
        target[i] = running;
        running += push.predicate != 0u ? uint(word != 0u) : word;
    }
}
