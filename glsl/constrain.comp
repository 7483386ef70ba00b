#version 460
// constrain: culls all splats outside of a set: they touch no tile. The set is the constrained splats, those that existed
// at the end of the low-frequency stage, or all others, or all splats but a share that is drawn anew in each step. One
// thread owns one splat; one workgroup owns 64 consecutive splats.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "random.glsl"
layout(local_size_x = 64) in;
layout(push_constant) uniform Push {
    uint others;    // 1: the set is the splats outside of the constrained set
    uint left_out;  // not 0: the set is all splats but a share of left_out / 2^32
    uint seed;      // of the draw; its key is (seed, step, identity of the splat)
    uint step;
} push;
const uint STREAM = 0xd209u;  // keeps the draws apart from those of other passes
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Ids { uint ids[]; };
layout(set = 0, binding = 2) writeonly buffer TileCounts { uint tile_counts[]; };
void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS]) return;
    bool outside = (ids[i] < counters[COUNTER_CONSTRAINED]) == (push.others != 0u);
    if (push.left_out != 0u) outside = random_bits(uvec4(push.seed, push.step, ids[i], STREAM)).x < push.left_out;
    if (outside) tile_counts[i] = 0u;
}
