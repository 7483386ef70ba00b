#version 460
// densify_views: counts a view of every splat that 3DGS counts as seen although no pixel centre lies within its
// ellipse. The reference counts a view where a square about the mean touches a tile of 16 x 16 pixels; its half side is
// three standard deviations of the longer axis, rounded up. One thread owns one splat and the third of its row of
// `stats`; one workgroup owns 64 consecutive splats.
//! texels means scales
#extension GL_GOOGLE_include_directive : require
#include "camera_push.glsl"
#include "common.glsl"
#include "counters.glsl"
#include "loads.glsl"
#include "projection.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 2) readonly buffer Means { float means[]; };
layout(set = 0, binding = 3) readonly buffer Quats { vec4 quats[]; };
layout(set = 0, binding = 4) readonly buffer Scales { float scales[]; };
layout(set = 0, binding = 5) buffer Stats { vec4 stats[]; };

const float REFERENCE_TILE = 16.0;
const float REFERENCE_LEAST_SPREAD = 0.1;  // px^4, under the root of the larger eigenvalue

void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS] || tile_counts[i] != 0u) return;
    const vec3 mean = LOAD3(means, i);
    const vec4 quat = LOAD4(quats, i);
    const vec3 log_scale = LOAD3(scales, i);
    const Camera camera = camera_from_push();
    const vec3 p = to_camera(camera, mean);
    if (!(finite(mean) && finite(quat) && finite(log_scale)) || p.z <= camera.near) return;
    const Ewa e = ewa_project(camera, p, quat, log_scale);
    const float a = dot(e.m0, e.m0), b = dot(e.m0, e.m1), c = dot(e.m1, e.m1);
    const float spread = max(REFERENCE_LEAST_SPREAD, 0.25 * (a - c) * (a - c) + b * b);
    const float radius = ceil(3.0 * sqrt(0.5 * (a + c) + DILATION + sqrt(spread)));
    // The reference has pixel centres at whole numbers.
    const vec2 at = camera.focal * (p.xy / p.z) + camera.principal - 0.5;
    const vec2 tiles = ceil(vec2(push.width, push.height) / REFERENCE_TILE);
    const bvec2 inside = bvec2(at.x + radius >= 1.0 && at.x - radius < REFERENCE_TILE * tiles.x,
                               at.y + radius >= 1.0 && at.y - radius < REFERENCE_TILE * tiles.y);
    if (all(inside) && finite(e.det) && finite(radius)) stats[i].z = LOAD4(stats, i).z + 1.0;
}
