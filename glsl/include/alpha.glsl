// The opacity of one splat at one pixel, shared by blend_forward and blend_backward so that both take the same decisions.
//
// alpha = min(0.99, opacity exp(-(A dx^2 + C dy^2) / 2 - B dx dy)); a splat is skipped where alpha < 1/255 or where the
// exponent is positive, and a pixel stops before the splat that would take its transmittance below 1e-4 (Kerbl et al. 2023).
// Everything is `precise`: contraction into fused operations would let two kernels disagree about a threshold.
#ifndef ALPHA_GLSL
#define ALPHA_GLSL

const float ALPHA_MIN = 1.0 / 255.0;
const float ALPHA_MAX = 0.99;
const float TRANSMITTANCE_MIN = 1e-4;

// The conic in units of the base-2 exponent: (-A/2, -B, -C/2) log2(e).
vec3 scaled_conic(vec3 conic) {
    precise vec3 scaled = conic * vec3(-0.72134752, -1.44269504, -0.72134752);
    return scaled;
}

// Exponent (base 2) at d = pixel centre - mean, from the parts that do not depend on dy: row_x = a dx dx, slope = b dx.
float exponent(float row_x, float slope, float c, float dy) {
    precise float e = dy * (c * dy + slope) + row_x;
    return e;
}

// opacity 2^e, not yet clamped; 0 where the splat is skipped.
float unclamped_alpha(float e, float opacity) {
    precise float alpha = opacity * exp2(e);
    return alpha >= ALPHA_MIN && e <= 0.0 ? alpha : 0.0;
}

// Transmittance behind a splat.
float behind(float transmittance, float alpha) {
    precise float t = transmittance * (1.0 - alpha);
    return t;
}

#endif
