#version 460
// densify_map: writes source and identity of every row of the model after the density change. One thread owns one old
// splat and writes the rows that it becomes; one workgroup owns 64 consecutive old splats. Kept rows come first and in
// order; new rows get ascending identities from the next free identity, so identities stay strictly ascending.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "densify.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Flags { uint flags[]; };
layout(set = 0, binding = 2) readonly buffer Offsets { uint offsets[]; };
layout(set = 0, binding = 3) readonly buffer OldIds { uint old_ids[]; };
layout(set = 0, binding = 4) writeonly buffer Map { uint map[]; };
layout(set = 0, binding = 5) writeonly buffer Ids { uint ids[]; };
layout(push_constant) uniform Push { uint stride; } push;
void main() {
    const uint i = global_index();
    if (i >= push.stride || i >= counters[COUNTER_SPLATS]) return;
    const uint kept = offsets[push.stride];
    const uint born = counters[COUNTER_NEXT_ID];
    for (uint kind = 0u; kind < KIND_COUNT; ++kind) {
        const uint e = kind * push.stride + i;
        if (flags[e] != 0u) {
            const uint row = offsets[e];
            const bool moved = kind == KIND_KEPT && flags[KIND_CHILD_B * push.stride + i] != 0u;
            map[row] = map_entry(i, moved ? KIND_CHILD_A : kind);
            ids[row] = kind == KIND_KEPT ? old_ids[i] : born + (row - kept);
        }
    }
}
