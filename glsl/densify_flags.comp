#version 460
// densify_flags: reorders the flags of a density change from row order to the order of birth, which new rows and
// identities follow. One thread owns one splat of the capacity and its four flags; one workgroup owns 64 consecutive
// splats.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "densify.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer RowOf { uint row_of[]; };
layout(set = 0, binding = 1) readonly buffer ByRow { uint by_row[]; };
layout(set = 0, binding = 2) writeonly buffer Flags { uint flags[]; };
layout(push_constant) uniform Push { uint stride; } push;
void main() {
    const uint rank = global_index();
    if (rank >= push.stride) return;
    const uint row = row_of[rank];
    for (uint kind = 0u; kind < KIND_COUNT; ++kind) flags[kind * push.stride + rank] = by_row[kind * push.stride + row];
}
