#version 460
//! variant subgroup
//! variant emulated SUBGROUP_EMULATED
// scan_once: the whole of an exclusive prefix sum by one workgroup, for few words: one dispatch instead of three. A
// total that overflows becomes the largest word. The workgroup walks over the words; in each turn a thread owns ITEMS
// consecutive words. GPUs, where every turn waits for memory, take more threads.
#extension GL_GOOGLE_include_directive : require
#ifdef SUBGROUP_EMULATED
#define LOCAL_SIZE 64
#include "subgroup.glsl"
layout(local_size_x = LOCAL_SIZE) in;
#else
#include "subgroup.glsl"
layout(constant_id = 1) const uint LOCAL_SIZE = 64u;
layout(local_size_x = 64, local_size_x_id = 1) in;
#endif
#include "workgroup_sum.glsl"
#include "common.glsl"
#include "count.glsl"
layout(constant_id = 0) const uint ITEMS = 16u;
layout(set = 0, binding = 0) readonly buffer Source { uint words[]; };
layout(set = 0, binding = 1) buffer Counters { uint counters[]; };
layout(set = 0, binding = 2) writeonly buffer Target { uint target[]; };
layout(push_constant) uniform Push {
    uint source;     // counter that holds the count, or NO_COUNTER
    uint count;      // the count for NO_COUNTER
    uint divide;     // elements: table_size(count, divide, multiply)
    uint multiply;
    uint predicate;  // nonzero: sum 1 for every nonzero word
    uint total;      // counter that gets the sum, or NO_COUNTER
} push;
shared uint passed;  // nonzero: the sum has overflowed

void main() {
    if (local_index() == 0u) passed = 0u;
    barrier();
    // Only one workgroup is expected; further workgroups do nothing.
    const bool owner = group_index() == 0u;
    const uint given = push.source == NO_COUNTER ? push.count : counters[push.source];
    const uint n = owner ? table_size(given, push.divide, push.multiply) : 0u;
    const uint turns = table_size(n, LOCAL_SIZE * ITEMS, 1u);
    uint carry = 0u;
    bool over = false;
    for (uint turn = 0u; turn < turns; ++turn) {
        const uint first = (turn * LOCAL_SIZE + workgroup_rank()) * ITEMS;
        const uint end = min(first + ITEMS, n);
        uint sum = 0u;
        for (uint i = first; i < end; ++i) {
            const uint word = words[i];
            sum += push.predicate != 0u ? uint(word != 0u) : word;
        }
        uint total;
        uint running = carry + workgroup_exclusive_add(sum, total);
        for (uint i = first; i < end; ++i) {
            const uint word = words[i];
            target[i] = running;
            const uint value = push.predicate != 0u ? uint(word != 0u) : word;
            running += value;
            over = over || running < value;
        }
        if (over) atomicOr(passed, 1u);
        carry += total;
    }
    barrier();
    if (owner && local_index() == 0u && push.total != NO_COUNTER) counters[push.total] = passed != 0u ? 0xffffffffu : carry;
}
