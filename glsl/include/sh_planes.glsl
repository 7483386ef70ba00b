// Loads of sh coefficients in 32-bit floats: a group of a splat as three rows.
#ifndef SH_PLANES_GLSL
#define SH_PLANES_GLSL

layout(set = 0, binding = 5) readonly buffer Sh0 { vec4 sh0[]; };
layout(set = 0, binding = 6) readonly buffer Sh1 { vec4 sh1[]; };
layout(set = 0, binding = 7) readonly buffer Sh2 { vec4 sh2[]; };
layout(set = 0, binding = 8) readonly buffer Sh3 { vec4 sh3[]; };

#define LOAD_SH(plane, row) LOAD4(plane, row)

#endif
