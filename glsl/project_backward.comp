#version 460
// project_backward: gradients of every splat's parameters from the gradients of its 2D Gaussian (columns of grad2d).
// One thread owns one splat; one workgroup owns 64 consecutive splats. A culled splat (tile count 0) gets zeros, and the
// price of its opacity and scale if these have one. With ADD = 1 gradients are added instead of written.
#extension GL_GOOGLE_include_directive : require
#include "camera_push.glsl"
#include "common.glsl"
#include "counters.glsl"
#include "splat_gradient.glsl"
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint AUX = 0u;
// Weight of the smallest standard deviation in the loss, a float as bits.
layout(constant_id = 1) const uint FLATTEN = 0u;
layout(constant_id = 2) const uint ADD = 0u;
// Weight of half the squared view-dependent coefficients in use in the loss, a float as bits.
layout(constant_id = 3) const uint SHRINK = 0u;
// Weights of the mean opacity and of the mean standard deviation of all splats in the loss, floats as bits.
layout(constant_id = 4) const uint PRICE_OPACITY = 0u;
layout(constant_id = 5) const uint PRICE_SCALE = 0u;
// Weight of o (1 - o) of the opacity of every splat on the image in the loss, a float as bits.
layout(constant_id = 6) const uint DECIDE = 0u;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Means { float means[]; };
layout(set = 0, binding = 2) readonly buffer Quats { vec4 quats[]; };
layout(set = 0, binding = 3) readonly buffer Scales { float scales[]; };
layout(set = 0, binding = 4) readonly buffer Opacities { float opacities[]; };
layout(set = 0, binding = 5) readonly buffer Sh0 { vec4 sh0[]; };
layout(set = 0, binding = 6) readonly buffer Sh1 { vec4 sh1[]; };
layout(set = 0, binding = 7) readonly buffer Sh2 { vec4 sh2[]; };
layout(set = 0, binding = 8) readonly buffer Sh3 { vec4 sh3[]; };
layout(set = 0, binding = 9) readonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 10) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 11) readonly buffer Grad2d { vec4 grad2d[]; };
layout(set = 0, binding = 12) readonly buffer GradNormals { vec4 grad_normals[]; };
layout(set = 0, binding = 13) buffer GMeans { float g_means[]; };
layout(set = 0, binding = 14) buffer GQuats { vec4 g_quats[]; };
layout(set = 0, binding = 15) buffer GScales { float g_scales[]; };
layout(set = 0, binding = 16) buffer GOpacities { float g_opacities[]; };
layout(set = 0, binding = 17) buffer GSh0 { vec4 g_sh0[]; };
layout(set = 0, binding = 18) buffer GSh1 { vec4 g_sh1[]; };
layout(set = 0, binding = 19) buffer GSh2 { vec4 g_sh2[]; };
layout(set = 0, binding = 20) buffer GSh3 { vec4 g_sh3[]; };

#define READ_SH(group, plane)          \
    splat.sh[3 * group] = plane[s];     \
    splat.sh[3 * group + 1] = plane[s + 1u]; \
    splat.sh[3 * group + 2] = plane[s + 2u]
#define WRITE(target, value) target = ADD != 0u ? target + (value) : (value)
#define WRITE_SH(plane, group, basis, weight0, weight1, weight2)                                   \
    WRITE(plane[s], SHRUNK(sh_outer0(basis, g.rgb), splat.sh[3 * group], weight0));          \
    WRITE(plane[s + 1u], SHRUNK(sh_outer1(basis, g.rgb), splat.sh[3 * group + 1], weight1)); \
    WRITE(plane[s + 2u], SHRUNK(sh_outer2(basis, g.rgb), splat.sh[3 * group + 2], weight2))

void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS]) return;
    const uint s = 3u * i;
    const uint degree = push.sh_degree;
    const bool priced = (PRICE_OPACITY | PRICE_SCALE) != 0u;
    if (ADD != 0u && tile_counts[i] == 0u && !priced) return;
    SplatGradient g = no_gradient();
    SplatParams splat;
    for (uint k = 0u; k < 12u; ++k) splat.sh[k] = vec4(0.0);
    // Weights by degree; zeros for a splat that is not on the image.
    vec3 shrink = vec3(0.0);
    if (tile_counts[i] != 0u) {
        splat.mean = vec3(means[s], means[s + 1u], means[s + 2u]);
        splat.quat = quats[i];
        splat.log_scale = vec3(scales[s], scales[s + 1u], scales[s + 2u]);
        splat.logit = opacities[i];
        READ_SH(0, sh0);
        if (degree >= 2u) {
            READ_SH(1, sh1);
            READ_SH(2, sh2);
        }
        if (degree >= 3u) {
            READ_SH(3, sh3);
        }
        const vec3 normal = AUX != 0u ? grad_normals[i].xyz : vec3(0.0);
        const Gradient2d up = Gradient2d(grad2d[s], grad2d[s + 1u], grad2d[s + 2u], normal);
        g = splat_gradient(camera_from_push(), degree, push.flags, splat, splat2d[s + 2u].xyz, up, AUX != 0u);
        if (FLATTEN != 0u) flatten(g, splat.log_scale, uintBitsToFloat(FLATTEN));
        if (SHRINK != 0u) shrink = of_degrees(uintBitsToFloat(SHRINK), degree);
        if (DECIDE != 0u) decide(g, splat.logit, uintBitsToFloat(DECIDE));
    }
    if (priced) {
        const vec3 log_scale = vec3(scales[s], scales[s + 1u], scales[s + 2u]);
        const float count = float(counters[COUNTER_SPLATS]);
        price(g, log_scale, opacities[i], uintBitsToFloat(PRICE_OPACITY) / count, uintBitsToFloat(PRICE_SCALE) / count);
    }

    WRITE(g_means[s], g.mean.x);
    WRITE(g_means[s + 1u], g.mean.y);
    WRITE(g_means[s + 2u], g.mean.z);
    WRITE(g_quats[i], g.quat);
    WRITE(g_scales[s], g.log_scale.x);
    WRITE(g_scales[s + 1u], g.log_scale.y);
    WRITE(g_scales[s + 2u], g.log_scale.z);
    WRITE(g_opacities[i], g.logit);
    WRITE_SH(g_sh0, 0, sh_basis0(g.dir, degree), vec4(vec3(0.0), shrink.x), shrink.xxxx, shrink.xxxx);
    const vec4 basis1 = degree >= 2u ? sh_basis1(g.dir) : vec4(0.0);
    const vec4 basis2 = degree >= 2u ? sh_basis2(g.dir, degree) : vec4(0.0);
    const vec4 basis3 = degree >= 3u ? sh_basis3(g.dir) : vec4(0.0);
    WRITE_SH(g_sh1, 1, basis1, shrink.yyyy, shrink.yyyy, shrink.yyyy);
    WRITE_SH(g_sh2, 2, basis2, shrink.yyyz, shrink.zzzz, shrink.zzzz);
    WRITE_SH(g_sh3, 3, basis3, shrink.zzzz, shrink.zzzz, shrink.zzzz);
}
