#version 460
// noise: moves the mean of every splat at random in the shape of the splat, the farther the fainter the splat is
// (3DGS-MCMC, Kheradmand et al. 2024): by rate * sigmoid(100 (0.005 - opacity)) * covariance * standard normals. The
// draw's key is (seed, step, identity of the splat). One thread owns one splat; one workgroup owns 64 consecutive
// splats.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "projection.glsl"
#include "random.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) buffer Means { float means[]; };
layout(set = 0, binding = 2) readonly buffer Quats { vec4 quats[]; };
layout(set = 0, binding = 3) readonly buffer Scales { float scales[]; };
layout(set = 0, binding = 4) readonly buffer Opacities { float opacities[]; };
layout(set = 0, binding = 5) readonly buffer Ids { uint ids[]; };
layout(push_constant) uniform Push { float rate; uint seed; uint step; } push;

const uint STREAM = 0x401ceu;    // keeps the draws apart from those of density changes
const float SHARPNESS = 100.0;
const float FAINT = 0.005;       // opacity with half of the noise

void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS]) return;
    const uint s = 3u * i;
    const Rotation rot = rotation_of(quats[i]);
    const vec3 sigma = exp(vec3(scales[s], scales[s + 1u], scales[s + 2u]));
    const vec3 xi = random_normals(uvec4(push.seed, push.step, ids[i], STREAM));
    const vec3 local = sigma * sigma * (rot.r0 * xi.x + rot.r1 * xi.y + rot.r2 * xi.z);
    const float gain = push.rate * sigmoid(SHARPNESS * (FAINT - sigmoid(opacities[i]).x)).x;
    const vec3 move = gain * vec3(dot(rot.r0, local), dot(rot.r1, local), dot(rot.r2, local));
    if (!finite(move)) return;
    means[s] += move.x;
    means[s + 1u] += move.y;
    means[s + 2u] += move.z;
}
