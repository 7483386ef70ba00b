// The PIXEL shape: tiles of 16x16 pixels, a workgroup per tile (blend_backward: per chunk of a tile's list), THREAD_PIXELS
// pixels per thread. For devices with wide subgroups and real shared memory: splats are staged there in batches. A
// subgroup owns THREAD_PIXELS blocks of pixels, see blocks.glsl. Before including: `#define THREAD_PIXELS n`.
#ifndef BLEND_PIXEL_GLSL
#define BLEND_PIXEL_GLSL

#extension GL_EXT_control_flow_attributes : require
#if THREAD_PIXELS == 1
#define LOCAL_SIZE 256
#else
#define LOCAL_SIZE 128
#endif
#ifdef WITH_SUBGROUPS
#include "subgroup.glsl"
#endif
#include "blend.glsl"

layout(local_size_x = LOCAL_SIZE) in;

const uint SIDE = 16u;
const uint BATCH = 128u;

#include "blocks.glsl"
#include "chunks.glsl"

// The lowest `count` bits, all 32 where there are more.
uint low_bits(uint count) { return count < 32u ? (1u << count) - 1u : ~0u; }

#endif
