// The alpha below which a splat is skipped at a pixel. What lists tiles and what blends are made with the same value.
#ifndef ALPHA_MIN_GLSL
#define ALPHA_MIN_GLSL

layout(constant_id = 20) const float ALPHA_MIN = 1.0 / 255.0;

#endif
