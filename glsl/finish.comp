#version 460
// finish: the last pass of an event: records that it happened, unless `status` says that it did not, and reports the counters and
// the losses in a slot of the ring that the host reads, whether it happened or not. With `constrain` the splats that there are become
// the constrained set, and with `caught_up` the steps that a splat has missed count from there on.
// One thread of one workgroup owns everything. `bad_splats` has been reported then, and counts anew.
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
