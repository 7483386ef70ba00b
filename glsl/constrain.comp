#version 460
// constrain: culls all splats outside of a set: they touch no tile. The set is the constrained splats, those that
// existed at the end of the low-frequency stage, or all others. One thread owns one splat; one workgroup owns 64
// consecutive splats.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
layout(local_size_x = 64) in;
layout(push_constant) uniform Push { uint others; } push;  // 1: the set is the splats outside of the constrained set
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Ids { uint ids[]; };
layout(set = 0, binding = 2) writeonly buffer TileCounts { uint tile_counts[]; };
void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS]) return;
    const bool constrained = ids[i] < counters[COUNTER_CONSTRAINED];
    if (constrained == (push.others != 0u)) tile_counts[i] = 0u;
}
