#version 460
// project_backward_adam: gradients of every splat's parameters from the gradients of its 2D Gaussian, fused with one
// step of Adam on all eight attribute planes and their moments in place: equals `project_backward` and eight times
// `adam`, without gradients in memory. One thread owns one splat with its 59 parameters and 118 moments; one workgroup
// owns 64 consecutive splats. A culled splat (tile count 0) steps with a gradient of zero: its moments decay and still
// move the splat, as in the 3DGS reference. With LISTED only splats on the image step, and each thread owns one of
// them.
//! texels means scales m_means m_scales v_means v_scales
#extension GL_GOOGLE_include_directive : require
#include "backward_adam.glsl"
