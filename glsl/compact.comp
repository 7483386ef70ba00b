#version 460
// compact: lists the visible splats (splats that touch a tile) in index order, with their depths as sort keys. One
// thread owns one splat; a workgroup owns 64 consecutive splats. `places` is the prefix sum of (tile_counts > 0).
// Depths are positive, so their bits order as integers; the lowest `shift` bits are dropped.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Splat2d { float splat2d[]; };
layout(set = 0, binding = 1) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 2) readonly buffer Places { uint places[]; };
layout(set = 0, binding = 3) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 4) writeonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 5) writeonly buffer Vals { uint vals[]; };
layout(push_constant) uniform Push { uint shift; } push;
void main() {
    const uint splat = global_index();
    if (splat >= counters[COUNTER_SPLATS] || tile_counts[splat] == 0u) return;
    const uint to = places[splat];
    keys[to] = floatBitsToUint(splat2d[splat * 12u + 6u]) >> push.shift;
    vals[to] = splat;
}
