#version 460
// project_backward_adam: gradients of every splat's parameters from the gradients of its 2D Gaussian, and with them one step of
// Adam on all eight attribute planes and their moments in place: `project_backward` and eight times `adam` without the gradients
// in between. One thread owns one splat with its 59 parameters and 118 moments; one workgroup owns 64 consecutive splats.
// A culled splat (tile count 0) steps with a gradient of zero: its moments decay and move it on, as in the 3DGS reference.
// Where LISTED only splats on the image step, and threads own those.
//! texels means scales m_means m_scales v_means v_scales
#extension GL_GOOGLE_include_directive : require
#include "backward_adam.glsl"
