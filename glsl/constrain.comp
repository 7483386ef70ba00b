#version 460
// constrain: culls all splats outside the constrained set, the splats that existed at the end of the low-frequency
// stage: other splats touch no tile. One thread owns one splat; one workgroup owns 64 consecutive splats.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Ids { uint ids[]; };
layout(set = 0, binding = 2) writeonly buffer TileCounts { uint tile_counts[]; };
void main() {
    const uint i = global_index();
    if (i < counters[COUNTER_SPLATS] && ids[i] >= counters[COUNTER_CONSTRAINED]) tile_counts[i] = 0u;
}
