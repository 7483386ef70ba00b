#version 460
// project_half: like project, with sh coefficients in half floats, two in a word. For renders only. One thread owns one
// splat; one workgroup owns 64 consecutive splats. A culled splat (behind the near plane, off screen, too faint, not
// finite) gets a tile count of 0; its other outputs are not written.
//! texels means scales
#extension GL_GOOGLE_include_directive : require
#define HALF
#include "project.glsl"
layout(local_size_x = 64) in;
void main() {
    const uint i = global_index();
    if (i < counters[COUNTER_SPLATS]) project_splat(camera_from_push(), i);
}
