#version 460
// finish: the last pass of an event; records that it happened, unless `status` says that it did not.
// One thread of one workgroup owns everything.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
layout(local_size_x = 1) in;
layout(set = 0, binding = 0) buffer Counters { uint counters[]; };
layout(push_constant) uniform Push { uint event; } push;
void main() {
    if (global_index() == 0u && counters[COUNTER_STATUS] == 0u) counters[COUNTER_DONE] = push.event;
}
