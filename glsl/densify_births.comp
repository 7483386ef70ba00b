#version 460
// densify_births: writes sort keys (identities) and values (rows) that bring the splats of a model into the order of
// birth. One thread owns one row of the capacity; one workgroup owns 64 consecutive rows. Rows beyond the model sort
// last.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Ids { uint ids[]; };
layout(set = 0, binding = 2) writeonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 3) writeonly buffer Vals { uint vals[]; };
layout(push_constant) uniform Push { uint stride; } push;
void main() {
    const uint row = global_index();
    if (row >= push.stride) return;
    uint key = 0xffffffffu;
    if (row < counters[COUNTER_SPLATS]) key = ids[row];
    keys[row] = key;
    vals[row] = row;
}
