#version 460
// project_half: as project, with the coefficients of the spherical harmonics in half floats, two in a word: pictures only.
// One thread owns one splat; one workgroup owns 64 consecutive splats.
// A culled splat (behind the near plane, off screen, too faint, not finite) gets a tile count of 0 and nothing else is written.
//! texels means scales
#extension GL_GOOGLE_include_directive : require
#define HALF
#include "project.glsl"
layout(local_size_x = 64) in;
void main() {
    const uint i = global_index();
    if (i < counters[COUNTER_SPLATS]) project_splat(camera_from_push(), i);
}
