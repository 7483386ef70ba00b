// The PIXEL shape: tiles of 16x16 pixels, a workgroup of 256 threads per tile, one thread per pixel. For devices with
// wide subgroups and real shared memory: splats are staged there in batches. Pixels are assigned in Morton order, so
// that the threads of a subgroup own a block: 4x2 pixels at a width of 8, 8x4 at 32, 8x8 at 64.
#ifndef BLEND_PIXEL_GLSL
#define BLEND_PIXEL_GLSL

#extension GL_EXT_control_flow_attributes : require
#define LOCAL_SIZE 256
#ifdef WITH_SUBGROUPS
#include "subgroup.glsl"
#endif
#include "blend.glsl"

layout(local_size_x = 256) in;

const uint SIDE = 16u;
const uint BATCH = 128u;

// This thread's rank in the Morton order of pixels.
#ifdef WITH_SUBGROUPS
uint pixel_rank() { return workgroup_rank(); }
#else
uint pixel_rank() { return local_index(); }
#endif

// Position of a pixel in the tile: the even bits of the rank are x, the odd bits y.
uvec2 pixel_place(uint rank) {
    const uvec2 bits = uvec2(rank, rank >> 1u);
    return (bits & 1u) | (bits >> 1u & 2u) | (bits >> 2u & 4u) | (bits >> 3u & 8u);
}

#endif
