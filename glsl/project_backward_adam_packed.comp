#version 460
// project_backward_adam_packed: as project_backward_adam, with both moments of a parameter in one word (see
// packed_moments.glsl). One thread owns one splat with its 59 parameters and 59 words of moments; one workgroup owns 64
// consecutive splats.
//! texels means scales
#extension GL_GOOGLE_include_directive : require
#define PACKED
#include "backward_adam.glsl"
