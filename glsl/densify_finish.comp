#version 460
// densify_finish: updates the counters after a density change. Runs last, and changes nothing after an overflow. One
// thread of the one workgroup does all.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Offsets { uint offsets[]; };
layout(set = 0, binding = 2) readonly buffer Tally { uint tally[]; };
layout(push_constant) uniform Push { uint stride; } push;
void main() {
    if (global_index() != 0u || counters[COUNTER_STATUS] != 0u) return;
    const uint total = counters[COUNTER_SCAN_TOTAL];
    const uint kept = offsets[push.stride];
    const uint cloned = offsets[2u * push.stride] - kept;
    // A split whose first child keeps the parent's row counts as kept.
    const uint replaced = offsets[3u * push.stride] - offsets[2u * push.stride];
    counters[COUNTER_CLONED] = cloned;
    counters[COUNTER_SPLIT] = total - offsets[3u * push.stride];
    counters[COUNTER_PRUNED] = counters[COUNTER_SPLATS] - kept - replaced;
    counters[COUNTER_BAD_SPLATS] += tally[0];
    counters[COUNTER_NEXT_ID] += total - kept;
    counters[COUNTER_SPLATS] = total;
}
