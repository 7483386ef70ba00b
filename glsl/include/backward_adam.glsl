// The body of project_backward_adam and of the variant with packed moments (PACKED).
#include "adam.glsl"
#include "common.glsl"
#include "counters.glsl"
#include "loads.glsl"
#include "splat_gradient.glsl"
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint AUX = 0u;
// Coefficients above this degree never had a gradient. Their moments are zero, so a step would not change them and
// skips them.
layout(constant_id = 1) const uint DEGREE = 3u;
// Floats as bits.
layout(constant_id = 2) const uint BETA1 = 0x3f666666u;  // 0.9
layout(constant_id = 3) const uint GAIN1 = 0x3dcccccdu;  // 1 - beta1
layout(constant_id = 4) const uint BETA2 = 0x3f7fbe77u;  // 0.999
layout(constant_id = 5) const uint GAIN2 = 0x3a83126fu;  // 1 - beta2
layout(constant_id = 6) const uint EPS = 0x26901d7du;    // 1e-15
// Weight of the smallest standard deviation in the loss, a float as bits.
layout(constant_id = 7) const uint FLATTEN = 0u;
// Weight of half the squared view-dependent coefficients in use in the loss, a float as bits.
layout(constant_id = 8) const uint SHRINK = 0u;
// Nonzero: only splats on the image step; thread k owns the k-th of them in index order. In a missed step the gradient
// of a splat is zero, but the moments decay and still move the splat; the splat makes up for the missed steps at its
// next step. So that renders show the right position, a splat also moves in advance for the steps that it is expected
// to miss, and later makes up only for the difference.
layout(constant_id = 9) const uint LISTED = 0u;
// Nonzero: no step. Every splat makes up for its missed steps.
layout(constant_id = 10) const uint CATCHES_UP = 0u;
// Weights of the mean opacity and of the mean standard deviation of all splats in the loss, floats as bits. A splat
// that takes no step (LISTED) has no such gradient.
layout(constant_id = 11) const uint PRICE_OPACITY = 0u;
layout(constant_id = 12) const uint PRICE_SCALE = 0u;
// Weight of o (1 - o) of the opacity of every splat on the image in the loss, a float as bits; counts in steps with
// FLAG_DECIDES.
layout(constant_id = 13) const uint DECIDE = 0u;
// Nonzero: coefficients and means are read again where they step. Otherwise some 50 registers keep them, and the
// direction of the basis, until then. Pays where the second read of a step comes from a cache.
layout(constant_id = 14) const uint READS_AGAIN = 0u;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 2) readonly buffer OnImage { uint on_image[]; };  // tile counts, or splats (LISTED)
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
layout(push_constant) uniform Push {
    vec4 row0;    // rotation row 0 | translation x (scene to camera)
    vec4 row1;
    vec4 row2;
    vec3 center;  // of the camera, in the scene
    uint flags;   // VIEW_*, FLAG_*; bits 8 and 9: sh degree in use; from bit 16 on: step
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
const uint FLAG_DECIDES = 16u;

// For the thread's splat (LISTED, CATCHES_UP): the missed steps minus the advance, and the number of steps taken at
// once: this step and the steps that the splat is expected to miss next.
AdamMissed missed = AdamMissed(1.0, 1.0, 0.0);
float at_once = 1.0;

float adam1(AdamStep step, float lr, float g, float param, inout float m, inout float v) {
    if (LISTED == 0u && CATCHES_UP == 0u) return adam(step, lr, g, param, m, v);
    const float begun = adam_catch_up(step, missed, lr, param, m, v);
    // An invalid gradient counts as zero, because the splat's row of `stats` holds for all its elements.
    return CATCHES_UP != 0u ? begun : adam(step, at_once * lr, adam_accepts(g) ? g : 0.0, begun, m, v);
}

vec4 adam4(AdamStep step, vec4 lr, vec4 g, vec4 param, inout vec4 m, inout vec4 v) {
    return vec4(adam1(step, lr.x, g.x, param.x, m.x, v.x), adam1(step, lr.y, g.y, param.y, m.y, v.y),
                adam1(step, lr.z, g.z, param.z, m.z, v.z), adam1(step, lr.w, g.w, param.w, m.w, v.w));
}

#ifdef PACKED
#include "packed_moments.glsl"
#else
#include "moments.glsl"
#endif

// The advance is stored in this many parts of the total distance that the moments would ever move an element.
const float PARTS = 255.0;
// Share of the latest gap between two steps in the estimate of the next gap.
const float LATEST = 0.25;

// Sets `missed` and `at_once`, and stores for the splat's next step, in its row of `stats`, the number of this step
// plus 2^16 times the parts of the advance. False when there is nothing to do.
bool begin_splat(AdamStep step, uint i) {
    const uint now = push.flags >> 16u, row = uint(stats[4u * i + 3u]);
    const uint since_last = now - row & 0xffffu, since_all = now - counters[COUNTER_CAUGHT_UP] & 0xffffu;
    const uint since = min(since_last, since_all);
    const uint count = CATCHES_UP != 0u ? since : max(since, 1u) - 1u;
    // After a later catch-up of all splats the row is outdated.
    const float advanced = since_last <= since_all ? float(row >> 16u) : 0.0;
    if (CATCHES_UP != 0u && count == 0u && advanced == 0.0) return false;
    missed = adam_missed(step, count);
    const float decay = adam_decay(step);
    precise float part = decay / (1.0 - decay) / PARTS;
    precise float parts = missed.moved / part;
    precise float expected = advanced == 0.0 ? parts : advanced + LATEST * (parts - advanced);
    const float advance = CATCHES_UP != 0u ? 0.0 : floor(expected + 0.5);
    missed.moved -= advanced * part;
    at_once = 1.0 + advance * part;
    stats[4u * i + 3u] = float(now) + 65536.0 * advance;
    return true;
}

#define LOAD_SH(plane, group)                           \
    splat.sh[3 * group] = LOAD4(plane, s);              \
    splat.sh[3 * group + 1] = LOAD4(plane, s + 1u);     \
    splat.sh[3 * group + 2] = LOAD4(plane, s + 2u);
#define STEP_ROW(plane, first, second, at, element, rates, outer, kept, weight)                   \
    {                                                                                             \
        const vec4 old = READS_AGAIN != 0u ? LOAD4(plane, at) : kept;                             \
        STEP4(plane, first, second, at, element, rates, SHRUNK(outer, old, weight), old)          \
    }
#define STEP_SH(plane, first, second, group, element, basis, weight)                                                        \
    STEP_ROW(plane, first, second, s, element, rest, sh_outer0(basis, g.rgb), splat.sh[3 * group], weight)                  \
    STEP_ROW(plane, first, second, s + 1u, element + 4u, rest, sh_outer1(basis, g.rgb), splat.sh[3 * group + 1], weight)    \
    STEP_ROW(plane, first, second, s + 2u, element + 8u, rest, sh_outer2(basis, g.rgb), splat.sh[3 * group + 2], weight)

void main() {
    const uint at = global_index();
    if (at >= counters[LISTED != 0u ? COUNTER_VISIBLE : COUNTER_SPLATS]) return;
    const uint i = LISTED != 0u ? on_image[at] : at;
    const uint s = 3u * i;
    AdamStep step = AdamStep(uintBitsToFloat(BETA1), uintBitsToFloat(GAIN1), uintBitsToFloat(BETA2), uintBitsToFloat(GAIN2),
                             uintBitsToFloat(EPS), push.inv_bias1, push.inv_sqrt_bias2);
    // Later rows have no coefficients above degree 1, and no moments of them.
    const bool full = i < FULL_ROWS;
    const uint in_use = (push.flags >> 8u) & 3u;
    const uint degree = full ? in_use : min(in_use, 1u);
    SplatParams splat;
    splat.mean = LOAD3(means, i);
    splat.quat = LOAD4(quats, i);
    splat.log_scale = LOAD3(scales, i);
    splat.logit = opacities[i];
    splat.sh[0] = LOAD4(sh0, s);
    if (DEGREE >= 1u) {
        splat.sh[1] = LOAD4(sh0, s + 1u);
        splat.sh[2] = LOAD4(sh0, s + 2u);
    }
    if (DEGREE >= 2u && full) {
        LOAD_SH(sh1, 1)
        LOAD_SH(sh2, 2)
    }
    if (DEGREE >= 3u && full) {
        LOAD_SH(sh3, 3)
    }

    SplatGradient g = no_gradient();
    // Weights by degree; zeros for a splat that is not on the image.
    vec3 shrink = vec3(0.0);
    const bool shown = CATCHES_UP == 0u && (LISTED != 0u || on_image[at] != 0u);
    if (shown) {
        const Camera camera =
            Camera(push.row0.xyz, push.row1.xyz, push.row2.xyz, vec3(push.row0.w, push.row1.w, push.row2.w), push.center,
                   0.0, push.focal, vec2(0.0), push.limits);
        const vec3 normal = AUX != 0u ? LOAD4(grad_normals, i).xyz : vec3(0.0);
        const Gradient2d up = Gradient2d(LOAD4(grad2d, s), LOAD4(grad2d, s + 1u), LOAD4(grad2d, s + 2u), normal);
        g = splat_gradient(camera, degree, push.flags, splat, LOAD4(splat2d, s + 2u).xyz, up, AUX != 0u);
        if (FLATTEN != 0u) flatten(g, splat.log_scale, uintBitsToFloat(FLATTEN));
        if (SHRINK != 0u) shrink = of_degrees(uintBitsToFloat(SHRINK), degree);
        if (DECIDE != 0u && (push.flags & FLAG_DECIDES) != 0u) decide(g, splat.logit, uintBitsToFloat(DECIDE));
    }
    if (CATCHES_UP == 0u && (PRICE_OPACITY | PRICE_SCALE) != 0u) {
        const float count = float(counters[COUNTER_SPLATS]);
        price(g, splat.log_scale, splat.logit, uintBitsToFloat(PRICE_OPACITY) / count, uintBitsToFloat(PRICE_SCALE) / count);
    }

    // After the gradients, so that no register has to keep the missed steps meanwhile.
    if (LISTED != 0u || CATCHES_UP != 0u) {
        if (!begin_splat(step, i)) return;
    }
    STEP4(quats, m_quats, v_quats, i, 3u, vec4(push.lr_quats), g.quat, splat.quat)
    STEP3(scales, m_scales, v_scales, 7u, push.lr_scales, g.log_scale, splat.log_scale)
    // The mean is read again too, for the direction of the basis, which no register has kept. So the mean steps last.
    if (READS_AGAIN != 0u) {
        splat.mean = LOAD3(means, i);
        const vec3 offset = splat.mean - push.center;
        g.dir = shown ? offset / length(offset) : vec3(0.0);
    }
    const vec4 rest = vec4(push.lr_sh_rest);
    const vec4 head = vec4(vec3(push.lr_sh_base), push.lr_sh_rest);
    const vec4 basis0 = sh_basis0(g.dir, degree);
    STEP_ROW(sh0, m_sh0, v_sh0, s, 11u, head, sh_outer0(basis0, g.rgb), splat.sh[0], vec4(vec3(0.0), shrink.x))
    if (DEGREE >= 1u) {
        STEP_ROW(sh0, m_sh0, v_sh0, s + 1u, 15u, rest, sh_outer1(basis0, g.rgb), splat.sh[1], shrink.xxxx)
        STEP_ROW(sh0, m_sh0, v_sh0, s + 2u, 19u, rest, sh_outer2(basis0, g.rgb), splat.sh[2], shrink.xxxx)
    }
    if (DEGREE >= 2u && full) {
        const vec4 basis1 = degree >= 2u ? sh_basis1(g.dir) : vec4(0.0);
        STEP_SH(sh1, m_sh1, v_sh1, 1, 23u, basis1, shrink.yyyy)
        const vec4 basis2 = degree >= 2u ? sh_basis2(g.dir, degree) : vec4(0.0);
        STEP_ROW(sh2, m_sh2, v_sh2, s, 35u, rest, sh_outer0(basis2, g.rgb), splat.sh[6], shrink.yyyz)
        // The fifth coefficient of degree 2 stands alone in its group.
        if (DEGREE >= 3u) {
            STEP_ROW(sh2, m_sh2, v_sh2, s + 1u, 39u, rest, sh_outer1(basis2, g.rgb), splat.sh[7], shrink.zzzz)
            STEP_ROW(sh2, m_sh2, v_sh2, s + 2u, 43u, rest, sh_outer2(basis2, g.rgb), splat.sh[8], shrink.zzzz)
        }
    }
    if (DEGREE >= 3u && full) {
        const vec4 basis3 = degree >= 3u ? sh_basis3(g.dir) : vec4(0.0);
        STEP_SH(sh3, m_sh3, v_sh3, 3, 47u, basis3, shrink.zzzz)
    }
    STEP3(means, m_means, v_means, 0u, push.lr_means, g.mean, splat.mean)
    if ((push.flags & FLAG_STEPS_OPACITIES) != 0u) {
        step.inv_bias1 = push.inv_bias1_opacities;
        step.inv_sqrt_bias2 = push.inv_sqrt_bias2_opacities;
        STEP1(opacities, m_opacities, v_opacities, i, 10u, step, push.lr_opacities, g.logit, splat.logit)
    }
}
