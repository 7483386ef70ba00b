#version 460
// densify_sample: decides which splats a density change keeps, splits and prunes, for sampled growth. A splat whose
// gradient reaches the threshold for its frequencies is split with a probability that grows with its gradient, its mask
// value and its error count (progressive spectral residual splatting, arXiv 2503.00848; error counts as in FastGS).
// Nothing is cloned. The first child of a split takes the parent's row and identity; the second child is new. Splats
// that blended into no pixel of the views since the last change are pruned. The pass uses no transcendental function,
// so the decisions are equal on every device. One thread owns one splat of the capacity and its flag in each of the
// four segments of `flags`, which are `stride` words apart (kept, clone, first child, second child); one workgroup owns
// 64 consecutive splats. Beyond the model flags are 0.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "densify.glsl"
#include "finite.glsl"
#include "random.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Means { float means[]; };
layout(set = 0, binding = 2) readonly buffer Quats { float quats[]; };
layout(set = 0, binding = 3) readonly buffer Scales { float scales[]; };
layout(set = 0, binding = 4) readonly buffer Opacities { float opacities[]; };
layout(set = 0, binding = 5) readonly buffer Sh0 { float sh0[]; };
layout(set = 0, binding = 6) readonly buffer Sh1 { float sh1[]; };
layout(set = 0, binding = 7) readonly buffer Sh2 { float sh2[]; };
layout(set = 0, binding = 8) readonly buffer Sh3 { float sh3[]; };
layout(set = 0, binding = 9) readonly buffer Stats { vec4 stats[]; };
layout(set = 0, binding = 10) readonly buffer Scores { vec2 scores[]; };
layout(set = 0, binding = 11) readonly buffer Ids { uint ids[]; };
layout(set = 0, binding = 12) writeonly buffer Flags { uint flags[]; };
layout(set = 0, binding = 13) buffer Tally { uint tally[]; };
layout(push_constant) uniform Push {
    uint stride;
    float low_threshold;
    float high_threshold;
    uint absolute;
    float rate;
    float mask_share;
    float error_share;
    float prune_opacity;
    float prune_scale;
    uint prune_large;
    uint prune_unseen;
    uint seed;
    uint event;
} push;

#include "all_finite.glsl"

// Separates these draws from the draws of `densify_means`, whose keys have the number of the child here.
const uint DRAW_SPLIT = 2u;

// Mean gradient divided by the threshold, interpolated between low and high frequencies; 0 below the threshold.
float excess(vec4 s, float mask) {
    const float sum = push.absolute != 0u ? s.y : s.x;
    if (!(s.z > 0.0) || !finite(sum)) return 0.0;
    precise float threshold = (push.low_threshold + (push.high_threshold - push.low_threshold) * mask) * s.z;
    return sum >= threshold ? sum / max(threshold, 1e-30) : 0.0;
}

bool drawn(uint i, vec4 s) {
    const vec2 score = scores[i];
    const bool scored = s.z > 0.0 && s.y > 0.0 && finite(score.x) && finite(score.y) && finite(s.y);
    const float mask = scored ? clamp(score.x / s.y, 0.0, 1.0) : 0.0;
    const float error = scored ? clamp(score.y / s.z, 0.0, 1.0) : 0.0;
    precise float of_mask = 1.0 + push.mask_share * (mask - 1.0);
    precise float of_error = 1.0 + push.error_share * (error - 1.0);
    precise float probability = push.rate * excess(s, mask) * of_mask * of_error;
    const uint bits = random_bits(uvec4(push.seed, push.event, ids[i], DRAW_SPLIT)).x;
    return float(bits >> 8u) < probability * 16777216.0;
}

void main() {
    const uint i = global_index();
    if (i >= push.stride) return;
    bool lives = false;
    bool child = false;
    if (i < counters[COUNTER_SPLATS]) {
        if (all_finite(i)) {
            const vec4 s = stats[i];
            const float largest = max(max(scales[3u * i], scales[3u * i + 1u]), scales[3u * i + 2u]);
            const bool seen = push.prune_unseen == 0u || s.y > 0.0;
            const bool opaque = !(opacities[i] < push.prune_opacity);
            const bool size_ok = push.prune_large == 0u || !(largest > push.prune_scale);
            lives = opaque && size_ok && seen;
            child = lives && drawn(i, s);
        } else {
            atomicAdd(tally[0], 1u);
        }
    }
    flags[i] = uint(lives);
    flags[push.stride + i] = 0u;
    flags[2u * push.stride + i] = 0u;
    flags[3u * push.stride + i] = uint(child);
}
