// Shared by every pass: linear indices for dispatches folded over two axes. A device may limit one axis to 65,535
// workgroups, so group g runs as (g % x, g / x). Use the functions here, never gl_GlobalInvocationID.
//
// Loops that "test at their end", `do { ... } while (...)`: lavapipe branches only at loop ends. For a loop that tests
// at its start, lavapipe runs the body once more without active lanes, and may merge the changed variables under the
// mask three times per turn instead of once.
#ifndef COMMON_GLSL
#define COMMON_GLSL

uint group_index() { return gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x; }
uint local_index() { return gl_LocalInvocationID.x; }
// A macro, because glslang takes gl_WorkGroupSize for 1 in code before the shader's local_size.
#define global_index() (group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x)

#endif
