// What every pass shares: linear indices over dispatches that are folded into two axes.
// A device may limit one axis to 65,535 workgroups, so group g runs as (g % x, g / x): use these, never gl_GlobalInvocationID.
//
// Loops that "test at their end", `do { ... } while (...)`: where a loop tests at its start, lavapipe, which branches at ends only, runs the
// body once more with no lane active, and may merge all that the loop changes under the mask three times a turn, not once.
#ifndef COMMON_GLSL
#define COMMON_GLSL

uint group_index() { return gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x; }
uint local_index() { return gl_LocalInvocationID.x; }
// A macro, because glslang takes gl_WorkGroupSize for 1 in code that stands before the shader's local_size, as this does.
#define global_index() (group_index() * gl_WorkGroupSize.x + gl_LocalInvocationID.x)

#endif
