// The COLUMN shape: tiles of 8x8 pixels, a workgroup of 8 threads per tile, one thread per column of 8 pixels. For CPU
// devices with subgroups of width 8: a load costs as much for one pixel as for eight, shared memory and barriers are
// slow, and a shuffle is one instruction. Eight splats are loaded at a time, one per thread, and shared by shuffles.
// The workgroup is one subgroup of width 8: the hardware's own, or the emulation with that width.
#ifndef BLEND_COLUMN_GLSL
#define BLEND_COLUMN_GLSL

#extension GL_EXT_control_flow_attributes : require
#define LOCAL_SIZE 8
#define EMULATED_WIDTH_DEFAULT 8u
#include "subgroup.glsl"
#include "blend.glsl"

layout(local_size_x = 8) in;

const uint SIDE = 8u;
const uint BATCH = 8u;

#ifdef SUBGROUP_EMULATED

#include "staged.glsl"

// Prepares the batch for shuffled(). The emulation copies the whole batch through shared memory at once, because a
// barrier for each word makes a shader so long that some compilers take minutes.
void hand_out(Splat mine) {
    barrier();
    stage(gl_LocalInvocationID.x, mine);
    barrier();
}

Splat shuffled(Splat mine, uint k) { return staged(k); }

#else

void hand_out(Splat mine) {}

// The splat of lane k.
Splat shuffled(Splat mine, uint k) {
    Splat s;
    s.x = subgroup_shuffle(mine.x, k);
    s.y = subgroup_shuffle(mine.y, k);
    s.p = subgroup_shuffle(mine.p, k);
    s.q = subgroup_shuffle(mine.q, k);
    s.r = subgroup_shuffle(mine.r, k);
    s.opacity = subgroup_shuffle(mine.opacity, k);
    s.colour.x = subgroup_shuffle(mine.colour.x, k);
    s.colour.y = subgroup_shuffle(mine.colour.y, k);
    s.colour.z = subgroup_shuffle(mine.colour.z, k);
    if (AUX != 0u) {
        s.depth = subgroup_shuffle(mine.depth, k);
        s.normal.x = subgroup_shuffle(mine.normal.x, k);
        s.normal.y = subgroup_shuffle(mine.normal.y, k);
        s.normal.z = subgroup_shuffle(mine.normal.z, k);
        s.slope.x = subgroup_shuffle(mine.slope.x, k);
        s.slope.y = subgroup_shuffle(mine.slope.y, k);
    } else {
        s.depth = 0.0;
        s.normal = vec3(0.0);
        s.slope = vec2(0.0);
    }
    return s;
}

#endif

#endif
