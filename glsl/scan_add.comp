#version 460
//! variant subgroup
//! variant emulated SUBGROUP_EMULATED
// scan_add: third pass of a prefix sum: every word's exclusive prefix within its workgroup plus the workgroup's base.
// A workgroup owns 64 * ITEMS consecutive words; a subgroup ITEMS consecutive rows with one word per lane, and a thread
// one column, so that neighbouring threads load and store neighbouring words.
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
    const uint width = subgroup_width();
    const uint first = (group * LOCAL_SIZE + subgroup_number() * width) * ITEMS + subgroup_lane();
    uint before[ITEMS];
    uint sum = 0u;
    for (uint i = 0u; i < ITEMS; ++i) {
        const uint at = first + i * width;
        const uint word = at < n ? words[at] : 0u;
        const uint value = push.predicate != 0u ? uint(word != 0u) : word;
        const uint prefix = subgroup_exclusive_add(value);
        before[i] = sum + prefix;
        sum += subgroup_broadcast(prefix + value, width - 1u);
    }
    uint total;
    // The base of a subgroup is the base of its first lane.
    const uint begin = subgroup_broadcast(workgroup_exclusive_add(subgroup_elect() ? sum : 0u, total), 0u);
    const uint base = begin + (group < table_size(n, LOCAL_SIZE * ITEMS, 1u) ? sums[group] : 0u);
    for (uint i = 0u; i < ITEMS; ++i) {
        const uint at = first + i * width;
        if (at < n) target[at] = base + before[i];
    }
}
