#version 460
// densify_classify: decides which splats a density change keeps, clones, splits and prunes (3DGS, Kerbl et al. 2023;
// the absolute score for splits is AbsGS, Ye et al. 2024). The pass uses no transcendental function (scales are
// compared as logarithms, opacities as logits), so the decisions are equal on every device. One thread owns one splat
// of the capacity and its flag in each of the four segments of `flags`, which are `stride` words apart (kept, clone,
// first child, second child); one workgroup owns 64 consecutive splats. Beyond the model flags are 0.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "densify.glsl"
#include "finite.glsl"
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
layout(set = 0, binding = 10) writeonly buffer Flags { uint flags[]; };
layout(set = 0, binding = 11) buffer Tally { uint tally[]; };
layout(push_constant) uniform Push {
    uint stride;
    float clone_threshold;
    float split_threshold;
    uint split_absolute;
    float split_scale;
    float prune_opacity;
    float prune_scale;
    uint prune_large;
} push;

// sum / views >= threshold without division, whose rounding Vulkan leaves open. No views or a NaN scores 0.
bool reaches(float sum, float views, float threshold) {
    if (!(views > 0.0) || !finite(sum)) return threshold <= 0.0;
    return sum >= threshold * views;
}

#include "all_finite.glsl"

void main() {
    const uint i = global_index();
    if (i >= push.stride) return;
    bool kept = false;
    bool clone = false;
    bool child = false;
    if (i < counters[COUNTER_SPLATS]) {
        if (all_finite(i)) {
            const vec4 s = stats[i];
            const float largest = max(max(scales[3u * i], scales[3u * i + 1u]), scales[3u * i + 2u]);
            const bool large = largest > push.split_scale;
            const bool cloned = !large && reaches(s.x, s.z, push.clone_threshold);
            const float split_sum = push.split_absolute != 0u ? s.y : s.x;
            const bool split = large && reaches(split_sum, s.z, push.split_threshold);
            // Pruning judges the resulting rows: a clone by the size of its source, children by their own smaller size.
            const bool opaque = !(opacities[i] < push.prune_opacity);
            const bool size_ok = push.prune_large == 0u || !(largest > push.prune_scale);
            const bool child_size_ok = push.prune_large == 0u || !(largest - LN_SPLIT_SHRINK > push.prune_scale);
            kept = opaque && size_ok && !split;
            clone = opaque && size_ok && cloned;
            child = opaque && child_size_ok && split;
        } else {
            atomicAdd(tally[0], 1u);
        }
    }
    flags[i] = uint(kept);
    flags[push.stride + i] = uint(clone);
    flags[2u * push.stride + i] = uint(child);
    flags[3u * push.stride + i] = uint(child);
}
