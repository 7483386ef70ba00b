// The alpha cutoff: a splat is skipped at a pixel where its alpha is lower. Tile lists and blending use the same value.
#ifndef ALPHA_MIN_GLSL
#define ALPHA_MIN_GLSL

layout(constant_id = 20) const float ALPHA_MIN = 1.0 / 255.0;

#endif
