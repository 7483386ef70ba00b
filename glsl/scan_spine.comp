#version 460
//! variant subgroup
//! variant emulated SUBGROUP_EMULATED
// scan_spine: second pass of a prefix sum: the exclusive prefix sum of the workgroups' sums, in place, and the total. A
// total that overflows becomes the largest word, so that the capacity check fails. One workgroup owns all sums and
// walks over them; in each turn a thread owns ITEMS consecutive sums.
#extension GL_GOOGLE_include_directive : require
#define LOCAL_SIZE 64
#include "subgroup.glsl"
#include "workgroup_sum.glsl"
#include "common.glsl"
#include "count.glsl"
layout(local_size_x = LOCAL_SIZE) in;
layout(constant_id = 0) const uint ITEMS = 16u;
layout(set = 0, binding = 0) buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) buffer Sums { uint sums[]; };
layout(push_constant) uniform Push {
    uint source;     // counter that holds the count, or NO_COUNTER
    uint count;      // the count for NO_COUNTER
    uint divide;     // elements: table_size(count, divide, multiply)
    uint multiply;
    uint predicate;  // nonzero: sum 1 for every nonzero word
    uint total;      // counter that gets the sum, or NO_COUNTER (spine)
} push;
shared uint passed;  // nonzero: the sum has overflowed

void main() {
    if (local_index() == 0u) passed = 0u;
    barrier();
    // Only one workgroup is expected; further workgroups do nothing.
    const bool owner = group_index() == 0u;
    const uint given = push.source == NO_COUNTER ? push.count : counters[push.source];
    const uint n = table_size(given, push.divide, push.multiply);
    const uint blocks = owner ? table_size(n, LOCAL_SIZE * ITEMS, 1u) : 0u;
    const uint turns = table_size(blocks, LOCAL_SIZE * ITEMS, 1u);
    uint carry = 0u;
    bool over = false;
    for (uint turn = 0u; turn < turns; ++turn) {
        const uint first = (turn * LOCAL_SIZE + workgroup_rank()) * ITEMS;
        const uint end = min(first + ITEMS, blocks);
        uint sum = 0u;
        for (uint i = first; i < end; ++i) sum += sums[i];
        uint total;
        uint running = carry + workgroup_exclusive_add(sum, total);
        for (uint i = first; i < end; ++i) {
            const uint word = sums[i];
            sums[i] = running;
            running += word;
            over = over || running < word;
        }
        if (over) atomicOr(passed, 1u);
        carry += total;
    }
    barrier();
    if (owner && local_index() == 0u && push.total != NO_COUNTER) counters[push.total] = passed != 0u ? 0xffffffffu : carry;
}
