#version 460
// grad2d_keep: saves the gradients of projected splats before another render of the same view. Splats that are not on
// the image get zeros. One thread owns the row of 12 floats of one splat; one workgroup owns 64 consecutive splats.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 2) readonly buffer Grad2d { vec4 grad2d[]; };
layout(set = 0, binding = 3) writeonly buffer Kept { vec4 kept[]; };
void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS]) return;
    const bool seen = tile_counts[i] != 0u;
    for (uint k = 3u * i; k < 3u * i + 3u; ++k) {
        vec4 row = vec4(0.0);
        if (seen) row = grad2d[k];
        kept[k] = row;
    }
}
