// Adam's arithmetic, shared by the plain and any fused optimiser pass.
#ifndef ADAM_GLSL
#define ADAM_GLSL

const uint ADAM_LARGEST_BITS = 0x5e5e0b6bu;  // 4e18: its square still fits, with the sum of moments

// By bits, so that no assumption about NaN can remove it.
bool adam_accepts(float g) { return (floatBitsToUint(g) & 0x7fffffffu) <= ADAM_LARGEST_BITS; }

float adam_first(float m, float g, float beta1, float gain1) { return beta1 * m + gain1 * g; }
float adam_second(float v, float g, float beta2, float gain2) { return beta2 * v + gain2 * (g * g); }

float adam_step(float m, float v, float lr, float eps, float inv_bias1, float inv_sqrt_bias2) {
    return lr * (m * inv_bias1) / (sqrt(v) * inv_sqrt_bias2 + eps);
}

#endif
