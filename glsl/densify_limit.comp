#version 460
// densify_limit: withdraws growth past a limit on the number of splats, the youngest sources first. A clone or a split adds
// one row each, so with an excess of e rows the last e of them (by birth) do not happen: an uncloned splat stays
// alone, an unsplit one stays whole. The limit never removes a splat.
// One thread owns one splat and its four flags; one workgroup owns 64 consecutive splats. The scan is repeated afterwards.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "densify.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Offsets { uint offsets[]; };
layout(set = 0, binding = 2) buffer Flags { uint flags[]; };
layout(push_constant) uniform Push { uint stride; uint max_splats; } push;
void main() {
    const uint i = global_index();
    if (i >= push.stride || i >= counters[COUNTER_SPLATS]) return;
    const uint total = counters[COUNTER_SCAN_TOTAL];
    const uint excess = total > push.max_splats ? total - push.max_splats : 0u;
    const uint clones = push.stride;
    const uint children = 2u * push.stride;
    const uint second = 3u * push.stride;
    const uint growth = (offsets[children] - offsets[clones]) + (total - offsets[second]);
    const uint admitted = growth > excess ? growth - excess : 0u;
    const uint rank = (offsets[clones + i] - offsets[clones]) + (offsets[second + i] - offsets[second]);
    if (rank < admitted) return;
    if (flags[clones + i] != 0u) flags[clones + i] = 0u;
    if (flags[second + i] != 0u) {
        flags[i] = 1u;
        flags[children + i] = 0u;
        flags[second + i] = 0u;
    }
}
