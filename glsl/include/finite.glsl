// Finiteness by bits: Vulkan lets compilers assume that floats are never NaN, even in isnan(), but not so for integers.
#ifndef FINITE_GLSL
#define FINITE_GLSL

bool finite(float x) { return (floatBitsToUint(x) & 0x7f800000u) != 0x7f800000u; }
bool finite(vec2 x) { return finite(x.x) && finite(x.y); }
bool finite(vec3 x) { return finite(x.xy) && finite(x.z); }
bool finite(vec4 x) { return finite(x.xy) && finite(x.zw); }

#endif
