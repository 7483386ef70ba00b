#version 460
// densify_limit: withdraws growth past a limit on the number of splats. A clone or a split adds one row, so an excess
// of e rows withdraws e of them: the splat then stays unchanged. The remaining clones and splits are spread evenly over
// the order of birth, from a random start, so that no age is preferred. The limit never removes a splat. One thread
// owns one splat and its four flags; one workgroup owns 64 consecutive splats. The scan is repeated afterwards.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "densify.glsl"
#include "random.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Offsets { uint offsets[]; };
layout(set = 0, binding = 2) buffer Flags { uint flags[]; };
layout(push_constant) uniform Push { uint stride; uint max_splats; uint seed; uint event; } push;

// Separates this draw from draws keyed by a splat.
const uint DRAW_PLACE = 3u;

// a * b modulo m, for a and b below m < 2^31.
uint product_modulo(uint a, uint b, uint m) {
    uint sum = 0u;
    for (uint k = 0u; k < 31u; ++k) {
        sum = (2u * sum) % m;
        if ((b >> (30u - k) & 1u) != 0u) sum = (sum + a) % m;
    }
    return sum;
}

void main() {
    const uint i = global_index();
    if (i >= push.stride || i >= counters[COUNTER_SPLATS]) return;
    const uint total = counters[COUNTER_SCAN_TOTAL];
    const uint excess = total > push.max_splats ? total - push.max_splats : 0u;
    const uint clones = push.stride;
    const uint children = 2u * push.stride;
    const uint second = 3u * push.stride;
    const uint growth = (offsets[children] - offsets[clones]) + (total - offsets[second]);
    const uint admitted = growth > excess ? growth - excess : 0u;
    const uint rank = (offsets[clones + i] - offsets[clones]) + (offsets[second + i] - offsets[second]);
    if (growth == 0u || admitted == growth) return;
    // True for exactly `admitted` of `growth` ranks, for any start: the steps of a line.
    const uint place = random_bits(uvec4(push.seed, push.event, 0u, DRAW_PLACE)).x % growth;
    if ((product_modulo(admitted, rank % growth, growth) + place) % growth < admitted) return;
    if (flags[clones + i] != 0u) flags[clones + i] = 0u;
    if (flags[second + i] != 0u) {
        flags[i] = 1u;
        flags[children + i] = 0u;
        flags[second + i] = 0u;
    }
}
