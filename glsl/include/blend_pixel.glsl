// The PIXEL shape: tiles of 16x16 pixels, a workgroup of 256 threads per tile, one thread per pixel. For devices with wide
// subgroups and real shared memory: splats are staged there in batches.
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
const uint BATCH = 64u;

#endif
