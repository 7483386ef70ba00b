// The alpha of one splat at one pixel, shared by blend_forward, blend_backward and depth_probe so that all make the same
// decisions.
//
// alpha = min(0.99, opacity exp(-(A dx^2 + C dy^2) / 2 - B dx dy)); a splat is skipped where alpha < ALPHA_MIN, and a
// pixel stops before the splat that would take its transmittance below TRANSMITTANCE_MIN: 1/255 and 1e-4 (Kerbl et al.
// 2023); early training steps may use a higher ALPHA_MIN. The exponent is a sum of two squares, by the Cholesky factor
// of the conic. Along a needle the three terms of the plain form are large and cancel, while here the first square is
// small itself. And the exponent is never positive, so no test is needed. Everything is `precise`: with fused
// operations two kernels could disagree about a threshold.
#ifndef ALPHA_GLSL
#define ALPHA_GLSL

#include "alpha_min.glsl"

const float ALPHA_MAX = 0.99;
const float TRANSMITTANCE_MIN = 1e-4;

// (p, q, r) of the exponent (base 2) -(p dx + q dy)^2 - (r dy)^2, from A, B and rest = C - B^2 / A.
vec3 conic_factor(float a, float b, float rest) {
    precise float p = sqrt(0.72134752 * a);
    precise float q = 0.72134752 * b / p;
    precise float r = sqrt(0.72134752 * rest);
    return vec3(p, q, r);
}

// (p dx + q dy, r dy) at d = pixel centre - mean, from along = p dx, which does not depend on dy.
vec2 conic_roots(float along, float q, float r, float dy) {
    precise float x = along + q * dy;
    precise float y = r * dy;
    return vec2(x, y);
}

// Exponent (base 2) from the two terms.
float exponent(vec2 roots) {
    precise float e = -(roots.x * roots.x) - roots.y * roots.y;
    return e;
}

// opacity 2^e, not yet clamped; 0 where the splat is skipped.
float unclamped_alpha(float e, float opacity) {
    precise float alpha = opacity * exp2(e);
    return alpha >= ALPHA_MIN ? alpha : 0.0;
}

// Transmittance after a splat.
float attenuate(float transmittance, float alpha) {
    precise float t = transmittance * (1.0 - alpha);
    return t;
}

#endif
