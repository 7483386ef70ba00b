// What blend_forward (FORWARD) keeps for blend_backward in the PIXEL shape. Emulated subgroups walk every splat and need no masks.
#ifndef KEPT_GLSL
#define KEPT_GLSL

#ifdef FORWARD
layout(set = 0, binding = 9) writeonly buffer Masks { uint masks[]; };
layout(set = 0, binding = 10) buffer States { vec4 states[]; };
#elif defined(SLOTS)
#ifdef SUBGROUP_EMULATED
layout(set = 0, binding = 12) readonly buffer States { vec4 states[]; };
#else
layout(set = 0, binding = 12) readonly buffer Masks { uint masks[]; };
layout(set = 0, binding = 13) readonly buffer States { vec4 states[]; };
#endif
#else
#ifdef SUBGROUP_EMULATED
layout(set = 0, binding = 11) readonly buffer States { vec4 states[]; };
#else
layout(set = 0, binding = 11) readonly buffer Masks { uint masks[]; };
layout(set = 0, binding = 12) readonly buffer States { vec4 states[]; };
#endif
#endif

#endif
