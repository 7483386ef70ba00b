#version 460
//! variant subgroup
//! variant emulated SUBGROUP_EMULATED
// scan_reduce: first of the three passes of an exclusive prefix sum (reduce, then scan; no workgroup waits for
// another). One thread owns every 64th of the 64 * ITEMS consecutive words of its workgroup; the workgroup writes their
// sum.
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
layout(set = 0, binding = 2) writeonly buffer Sums { uint sums[]; };
layout(push_constant) uniform Push {
    uint source;     // counter that holds the count, or NO_COUNTER
    uint count;      // the count for NO_COUNTER
    uint divide;     // elements: table_size(count, divide, multiply)
    uint multiply;
    uint predicate;  // nonzero: sum 1 for every nonzero word
    uint total;      // counter that gets the sum, or NO_COUNTER (spine)
} push;
void main() {
    const uint given = push.source == NO_COUNTER ? push.count : counters[push.source];
    const uint n = table_size(given, push.divide, push.multiply);
    const uint group = group_index();
    const uint begin = group * LOCAL_SIZE * ITEMS;
    const uint end = min(begin + LOCAL_SIZE * ITEMS, n);
    uint sum = 0u;
    for (uint i = begin + local_index(); i < end; i += LOCAL_SIZE) {
        const uint word = words[i];
        sum += push.predicate != 0u ? uint(word != 0u) : word;
    }
    uint total;
    workgroup_exclusive_add(sum, total);
    if (local_index() == 0u && group < table_size(n, LOCAL_SIZE * ITEMS, 1u)) sums[group] = total;
}
