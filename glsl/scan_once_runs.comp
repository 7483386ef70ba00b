#version 460
// scan_once_runs: like scan_once, for CPU devices, where one subgroup is as fast as eight and barriers are slow. One
// workgroup, which is one subgroup of 8 threads, owns all words; one thread owns a run of consecutive words; all runs
// have equal length.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#define LOCAL_SIZE 8
#include "subgroup.glsl"
#include "common.glsl"
#include "count.glsl"
layout(local_size_x = 8) in;
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

const uint PER_TURN = 8u;

uint value_of(uint word) { return push.predicate != 0u ? uint(word != 0u) : word; }

void main() {
    // Only one workgroup is expected; further workgroups do nothing.
    const bool owner = group_index() == 0u;
    const uint given = push.source == NO_COUNTER ? push.count : counters[push.source];
    const uint n = owner ? table_size(given, push.divide, push.multiply) : 0u;
    const uint width = subgroup_width();
    const uint lane = subgroup_lane();
    const uint run = table_size(n, width, 1u);
    const uint first = min(lane * run, n);
    const uint end = min(first + run, n);

    // Both loops test at their end, see common.glsl.
    uint sum = 0u;
    uint at = first;
    do {
        [[unroll]] for (uint u = 0u; u < PER_TURN; ++u) {
            const uint i = at + u;
            if (i < end) sum += value_of(words[i]);
        }
        at += PER_TURN;
    } while (at < end);
    const uint before = subgroup_exclusive_add(sum);
    const uint total = subgroup_broadcast(before + sum, width - 1u);
    // At the first overflow the sum wraps within a thread's run.
    uint running = before;
    bool over = false;
    at = first;
    do {
        [[unroll]] for (uint u = 0u; u < PER_TURN; ++u) {
            const uint i = at + u;
            if (i < end) {
                const uint value = value_of(words[i]);
                target[i] = running;
                running += value;
                over = over || running < value;
            }
        }
        at += PER_TURN;
    } while (at < end);
    over = subgroup_any(over);
    if (owner && lane == 0u && push.total != NO_COUNTER) counters[push.total] = over ? 0xffffffffu : total;
}
