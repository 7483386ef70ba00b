#version 460
// densify_gather: writes one plane after a density change, from a copy of the plane before. Words are moved as bits.
// One thread owns one new row of WIDTH words; one workgroup owns 64 consecutive rows.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "densify.glsl"
#include "random.glsl"
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint WIDTH = 1u;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Map { uint map[]; };
layout(set = 0, binding = 2) readonly buffer Source { uint source[]; };
layout(set = 0, binding = 3) writeonly buffer Plane { uint plane[]; };
layout(push_constant) uniform Push { uint mode; float keep; } push;

const uint MODE_COPY = 0u;    // copy of the source
const uint MODE_SHRINK = 1u;  // logarithmic scales: children of a split are smaller
const uint MODE_MOMENT = 2u;  // moments: zero for new rows
const uint MODE_ZERO = 3u;    // statistics: zero for all
const uint MODE_SHRINK_AXIS = 4u;  // logarithmic scales: children are shorter along the split axis
const uint MODE_SHARE = 5u;   // opacity logits: two children match their parent; all times `keep`

// ln(keep o / (1 - keep o)), the logit of a reduced opacity.
float logit(float opacity) {
    precise float rest = 1.0 - opacity;
    precise float result = random_ln(opacity) - random_ln(rest);
    return result;
}

// Of a child along an axis: 1 - (1 - c o')^2 = o, o' at most o.
float shared_opacity(float opacity) {
    precise float below = 1.0 + sqrt(1.0 - opacity);
    precise float half_shown = opacity / below;
    precise float mine = half_shown * INVERSE_AXIS_CENTER;
    return min(mine, opacity);
}

uint faded(uint word, bool child) {
    if (!child && push.keep >= 1.0) return word;
    precise float below = 1.0 + random_exp(-uintBitsToFloat(word));
    precise float opacity = 1.0 / below;
    if (child) opacity = shared_opacity(opacity);
    precise float kept = opacity * push.keep;
    return floatBitsToUint(logit(clamp(kept, 1e-6, 1.0 - 1e-6)));
}

void main() {
    const uint row = global_index();
    if (row >= counters[COUNTER_SCAN_TOTAL]) return;
    const uint entry = map[row];
    const uint i = map_source(entry);
    const uint kind = map_kind(entry);
    const bool zero = push.mode == MODE_ZERO || (push.mode == MODE_MOMENT && kind != KIND_KEPT);
    const bool child = kind == KIND_CHILD_A || kind == KIND_CHILD_B;
    const bool shrink = push.mode == MODE_SHRINK && child;
    uint axis = WIDTH;
    if (WIDTH == 3u && push.mode == MODE_SHRINK_AXIS && child) {
        axis = map_axis(entry,
            uintBitsToFloat(source[3u * i]), uintBitsToFloat(source[3u * i + 1u]), uintBitsToFloat(source[3u * i + 2u]));
    }
    for (uint k = 0u; k < WIDTH; ++k) {
        uint word = source[WIDTH * i + k];
        if (push.mode == MODE_SHARE) word = faded(word, child);
        if (k == axis) word = floatBitsToUint(uintBitsToFloat(word) - LN_AXIS_SHRINK);
        if (shrink) word = floatBitsToUint(uintBitsToFloat(word) - LN_SPLIT_SHRINK);
        plane[WIDTH * row + k] = zero ? 0u : word;
    }
}
