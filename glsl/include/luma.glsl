// Brightness of a colour (Rec. 709).
#ifndef LUMA_GLSL
#define LUMA_GLSL

const vec3 LUMA = vec3(0.2126, 0.7152, 0.0722);

float luma(vec3 colour) { return dot(colour, LUMA); }

#endif
