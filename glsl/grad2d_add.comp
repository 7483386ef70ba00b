#version 460
// grad2d_add: adds the gradients saved by `grad2d_keep` to the gradients of another render of the same view, for
// projected splats on the image. Both renders project a splat to the same place. One thread owns the row of 12 floats
// of one splat; one workgroup owns 64 consecutive splats.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 2) readonly buffer Kept { vec4 kept[]; };
layout(set = 0, binding = 3) buffer Grad2d { vec4 grad2d[]; };
void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS] || tile_counts[i] == 0u) return;
    for (uint k = 3u * i; k < 3u * i + 3u; ++k) grad2d[k] += kept[k];
}
