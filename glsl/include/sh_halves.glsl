// Loads of sh coefficients in half floats: a group of a splat as three rows.
#ifndef SH_HALVES_GLSL
#define SH_HALVES_GLSL

layout(set = 0, binding = 5) readonly buffer Sh0 { uvec2 sh0[]; };
layout(set = 0, binding = 6) readonly buffer Sh1 { uvec2 sh1[]; };
layout(set = 0, binding = 7) readonly buffer Sh2 { uvec2 sh2[]; };
layout(set = 0, binding = 8) readonly buffer Sh3 { uvec2 sh3[]; };

vec4 halves(uvec2 words) { return vec4(unpackHalf2x16(words.x), unpackHalf2x16(words.y)); }
#define LOAD_SH(plane, row) halves(plane[row])

#endif
