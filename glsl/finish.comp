#version 460
// finish: the last pass of an event. Records the event as done unless `status` is set, and in any case reports counters
// and losses in a slot of the ring that the host reads. With `constrain` the current splats become the constrained set;
// with `caught_up` the missed steps of splats count from that step on. One thread of one workgroup owns everything.
// After the report `bad_splats` restarts from 0.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
layout(local_size_x = 1) in;
layout(set = 0, binding = 0) buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Loss { uint loss[]; };
layout(set = 0, binding = 2) writeonly buffer Ring { uint ring[]; };
layout(push_constant) uniform Push { uint event; uint constrain; uint caught_up; } push;
const uint NOT_CAUGHT_UP = 0xffffffffu;
void main() {
    if (global_index() != 0u) return;
    if (counters[COUNTER_STATUS] == 0u) {
        counters[COUNTER_DONE] = push.event;
        if (push.constrain != 0u) counters[COUNTER_CONSTRAINED] = counters[COUNTER_NEXT_ID];
        if (push.caught_up != NOT_CAUGHT_UP) counters[COUNTER_CAUGHT_UP] = push.caught_up;
    }
    for (uint i = 0u; i < COUNTER_COUNT; ++i) ring[i] = counters[i];
    for (uint i = 0u; i < 3u; ++i) ring[COUNTER_COUNT + i] = loss[i];
    counters[COUNTER_BAD_SPLATS] = 0u;
}
