#version 460
// plan: turns a count into workgroup counts for indirect dispatches, or into zeros when the count exceeds the capacity.
// One thread of one workgroup owns everything. When `status` is already set, counts are invalid and only zeros are
// written. In both cases the event is void, so the first `void_entries` entries of `args`, planned before, become zero
// too.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "count.glsl"
#include "counters.glsl"
layout(local_size_x = 1) in;
layout(set = 0, binding = 0) buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) writeonly buffer Args { uvec4 args[]; };
layout(push_constant) uniform Push {
    uint source;       // counter that holds the count
    uint capacity;     // largest count that fits
    uint status_bit;   // set in `status` when the count does not fit
    uint want;         // counter that keeps the largest count seen, or NO_COUNTER
    uint first;        // first entry of `args` to write
    uint entries;      // number of entries, at most 8
    uint void_entries; // entries from the first of `args` on that are zeroed when the event is void
    uint divide[8];    // the entry's elements: table_size(count, divide, multiply)
    uint multiply[8];
    uint items[8];     // elements per workgroup; 0: `multiply` workgroups regardless of the count
} push;

void main() {
    if (global_index() != 0u) return;
    const uint status = counters[COUNTER_STATUS];
    const uint count = counters[push.source];
    bool go = status == 0u;
    if (go) {
        // The index is always valid, even without a counter, because drivers may load before testing the condition.
        const uint wanted = push.want == NO_COUNTER ? push.source : push.want;
        const uint most = max(counters[wanted], count);
        if (push.want != NO_COUNTER) counters[wanted] = most;
        if (count > push.capacity) {
            counters[COUNTER_STATUS] = push.status_bit;
            go = false;
        }
    }
    const uint voided = go ? 0u : push.void_entries;
    for (uint i = 0u; i < voided; ++i) args[i] = uvec4(0u);
    for (uint i = 0u; i < min(push.entries, 8u); ++i) {
        const uint items = push.items[i];
        uint groups = push.multiply[i];
        if (items != 0u) groups = table_size(table_size(count, push.divide[i], push.multiply[i]), items, 1u);
        args[push.first + i] = entry_of(go ? groups : 0u);
    }
}
