#version 460
// project_backward_adam: gradients of every splat's parameters from the gradients of its 2D Gaussian, and with them one step of
// Adam on all eight attribute planes and their moments in place: `project_backward` and eight times `adam` without the gradients
// in between. One thread owns one splat with its 59 parameters and 118 moments; one workgroup owns 64 consecutive splats.
// A culled splat (tile count 0) steps with a gradient of zero: its moments decay and move it on, as in the 3DGS reference.
#extension GL_GOOGLE_include_directive : require
#include "adam.glsl"
#include "common.glsl"
#include "counters.glsl"
#include "splat_gradient.glsl"
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint AUX = 0u;
// Coefficients of the spherical harmonics above this degree never had a gradient: their moments are zero, a step would leave
// them as they are, and they are not touched.
layout(constant_id = 1) const uint DEGREE = 3u;
// Floats as bits.
layout(constant_id = 2) const uint BETA1 = 0x3f666666u;  // 0.9
layout(constant_id = 3) const uint GAIN1 = 0x3dcccccdu;  // 1 - beta1
layout(constant_id = 4) const uint BETA2 = 0x3f7fbe77u;  // 0.999
layout(constant_id = 5) const uint GAIN2 = 0x3a83126fu;  // 1 - beta2
layout(constant_id = 6) const uint EPS = 0x26901d7du;    // 1e-15
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 2) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 3) readonly buffer Grad2d { vec4 grad2d[]; };
layout(set = 0, binding = 4) readonly buffer GradNormals { vec4 grad_normals[]; };
layout(set = 0, binding = 5) buffer Means { float means[]; };
layout(set = 0, binding = 6) buffer Quats { vec4 quats[]; };
layout(set = 0, binding = 7) buffer Scales { float scales[]; };
layout(set = 0, binding = 8) buffer Opacities { float opacities[]; };
layout(set = 0, binding = 9) buffer Sh0 { vec4 sh0[]; };
layout(set = 0, binding = 10) buffer Sh1 { vec4 sh1[]; };
layout(set = 0, binding = 11) buffer Sh2 { vec4 sh2[]; };
layout(set = 0, binding = 12) buffer Sh3 { vec4 sh3[]; };
layout(set = 0, binding = 13) buffer MMeans { float m_means[]; };
layout(set = 0, binding = 14) buffer MQuats { vec4 m_quats[]; };
layout(set = 0, binding = 15) buffer MScales { float m_scales[]; };
layout(set = 0, binding = 16) buffer MOpacities { float m_opacities[]; };
layout(set = 0, binding = 17) buffer MSh0 { vec4 m_sh0[]; };
layout(set = 0, binding = 18) buffer MSh1 { vec4 m_sh1[]; };
layout(set = 0, binding = 19) buffer MSh2 { vec4 m_sh2[]; };
layout(set = 0, binding = 20) buffer MSh3 { vec4 m_sh3[]; };
layout(set = 0, binding = 21) buffer VMeans { float v_means[]; };
layout(set = 0, binding = 22) buffer VQuats { vec4 v_quats[]; };
layout(set = 0, binding = 23) buffer VScales { float v_scales[]; };
layout(set = 0, binding = 24) buffer VOpacities { float v_opacities[]; };
layout(set = 0, binding = 25) buffer VSh0 { vec4 v_sh0[]; };
layout(set = 0, binding = 26) buffer VSh1 { vec4 v_sh1[]; };
layout(set = 0, binding = 27) buffer VSh2 { vec4 v_sh2[]; };
layout(set = 0, binding = 28) buffer VSh3 { vec4 v_sh3[]; };
layout(push_constant) uniform Push {
    vec4 row0;    // rotation row 0 | translation x (scene to camera)
    vec4 row1;
    vec4 row2;
    vec3 center;  // of the camera, in the scene
    uint flags;   // VIEW_*, FLAG_STEPS_OPACITIES; from bit 8 on the degree of the spherical harmonics in use
    vec4 limits;  // as in camera_push.glsl
    vec2 focal;   // pixels
    float lr_means;
    float lr_quats;
    float lr_scales;
    float lr_opacities;
    float lr_sh_base;  // the constant harmonic
    float lr_sh_rest;
    float inv_bias1;   // see AdamStep
    float inv_sqrt_bias2;
    float inv_bias1_opacities;
    float inv_sqrt_bias2_opacities;
} push;

const uint FLAG_STEPS_OPACITIES = 4u;

vec4 adam4(AdamStep step, vec4 lr, vec4 g, vec4 param, inout vec4 m, inout vec4 v) {
    return vec4(adam(step, lr.x, g.x, param.x, m.x, v.x), adam(step, lr.y, g.y, param.y, m.y, v.y),
                adam(step, lr.z, g.z, param.z, m.z, v.z), adam(step, lr.w, g.w, param.w, m.w, v.w));
}

#define LOAD3(plane) vec3(plane[s], plane[s + 1u], plane[s + 2u])
#define STEP1(plane, first, second, at, step, lr, g, old)  \
    {                                                      \
        float m = first[at], v = second[at];               \
        plane[at] = adam(step, lr, g, old, m, v);          \
        first[at] = m;                                     \
        second[at] = v;                                    \
    }
#define STEP3(plane, first, second, lr, g, old)                       \
    STEP1(plane, first, second, s, step, lr, (g).x, (old).x)          \
    STEP1(plane, first, second, s + 1u, step, lr, (g).y, (old).y)     \
    STEP1(plane, first, second, s + 2u, step, lr, (g).z, (old).z)
#define STEP4(plane, first, second, at, lr, g, old)        \
    {                                                      \
        vec4 m = first[at], v = second[at];                \
        plane[at] = adam4(step, lr, g, old, m, v);         \
        first[at] = m;                                     \
        second[at] = v;                                    \
    }
#define LOAD_SH(plane, group)                    \
    splat.sh[3 * group] = plane[s];              \
    splat.sh[3 * group + 1] = plane[s + 1u];     \
    splat.sh[3 * group + 2] = plane[s + 2u];
#define STEP_SH(plane, first, second, group, basis)                                                         \
    STEP4(plane, first, second, s, rest, sh_outer0(basis, g.rgb), splat.sh[3 * group])                      \
    STEP4(plane, first, second, s + 1u, rest, sh_outer1(basis, g.rgb), splat.sh[3 * group + 1])             \
    STEP4(plane, first, second, s + 2u, rest, sh_outer2(basis, g.rgb), splat.sh[3 * group + 2])

void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS]) return;
    const uint s = 3u * i;
    const uint degree = push.flags >> 8u;
    SplatParams splat;
    splat.mean = LOAD3(means);
    splat.quat = quats[i];
    splat.log_scale = LOAD3(scales);
    splat.logit = opacities[i];
    splat.sh[0] = sh0[s];
    if (DEGREE >= 1u) {
        splat.sh[1] = sh0[s + 1u];
        splat.sh[2] = sh0[s + 2u];
    }
    if (DEGREE >= 2u) {
        LOAD_SH(sh1, 1)
        LOAD_SH(sh2, 2)
    }
    if (DEGREE >= 3u) {
        LOAD_SH(sh3, 3)
    }

    SplatGradient g = no_gradient();
    if (tile_counts[i] != 0u) {
        const Camera camera =
            Camera(push.row0.xyz, push.row1.xyz, push.row2.xyz, vec3(push.row0.w, push.row1.w, push.row2.w), push.center,
                   0.0, push.focal, vec2(0.0), push.limits);
        const vec3 normal = AUX != 0u ? grad_normals[i].xyz : vec3(0.0);
        const Gradient2d up = Gradient2d(grad2d[s], grad2d[s + 1u], grad2d[s + 2u], normal);
        g = splat_gradient(camera, degree, push.flags, splat, splat2d[s + 2u].xyz, up, AUX != 0u);
    }

    AdamStep step = AdamStep(uintBitsToFloat(BETA1), uintBitsToFloat(GAIN1), uintBitsToFloat(BETA2), uintBitsToFloat(GAIN2),
                             uintBitsToFloat(EPS), push.inv_bias1, push.inv_sqrt_bias2);
    STEP3(means, m_means, v_means, push.lr_means, g.mean, splat.mean)
    STEP4(quats, m_quats, v_quats, i, vec4(push.lr_quats), g.quat, splat.quat)
    STEP3(scales, m_scales, v_scales, push.lr_scales, g.log_scale, splat.log_scale)
    const vec4 rest = vec4(push.lr_sh_rest);
    const vec4 head = vec4(vec3(push.lr_sh_base), push.lr_sh_rest);
    const vec4 basis0 = sh_basis0(g.dir, degree);
    STEP4(sh0, m_sh0, v_sh0, s, head, sh_outer0(basis0, g.rgb), splat.sh[0])
    if (DEGREE >= 1u) {
        STEP4(sh0, m_sh0, v_sh0, s + 1u, rest, sh_outer1(basis0, g.rgb), splat.sh[1])
        STEP4(sh0, m_sh0, v_sh0, s + 2u, rest, sh_outer2(basis0, g.rgb), splat.sh[2])
    }
    if (DEGREE >= 2u) {
        const vec4 basis1 = degree >= 2u ? sh_basis1(g.dir) : vec4(0.0);
        STEP_SH(sh1, m_sh1, v_sh1, 1, basis1)
        const vec4 basis2 = degree >= 2u ? sh_basis2(g.dir, degree) : vec4(0.0);
        STEP4(sh2, m_sh2, v_sh2, s, rest, sh_outer0(basis2, g.rgb), splat.sh[6])
        // The fifth coefficient of degree 2 stands alone in its group.
        if (DEGREE >= 3u) {
            STEP4(sh2, m_sh2, v_sh2, s + 1u, rest, sh_outer1(basis2, g.rgb), splat.sh[7])
            STEP4(sh2, m_sh2, v_sh2, s + 2u, rest, sh_outer2(basis2, g.rgb), splat.sh[8])
        }
    }
    if (DEGREE >= 3u) {
        const vec4 basis3 = degree >= 3u ? sh_basis3(g.dir) : vec4(0.0);
        STEP_SH(sh3, m_sh3, v_sh3, 3, basis3)
    }
    if ((push.flags & FLAG_STEPS_OPACITIES) != 0u) {
        step.inv_bias1 = push.inv_bias1_opacities;
        step.inv_sqrt_bias2 = push.inv_sqrt_bias2_opacities;
        STEP1(opacities, m_opacities, v_opacities, i, step, push.lr_opacities, g.logit, splat.logit)
    }
}
