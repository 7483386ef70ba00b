// Adam's arithmetic, shared by the plain and the fused optimiser pass: the same bits from the same gradient.
#ifndef ADAM_GLSL
#define ADAM_GLSL

const uint ADAM_LARGEST_BITS = 0x5e5e0b6bu;  // 4e18: its square still fits, with the sum of moments

// What an element's step needs beyond its rate.
struct AdamStep {
    float beta1;
    float gain1;           // 1 - beta1, rounded from double precision
    float beta2;
    float gain2;
    float eps;
    float inv_bias1;       // 1 / (1 - beta1^t)
    float inv_sqrt_bias2;  // 1 / sqrt(1 - beta2^t)
};

// By bits, so that no assumption about NaN can remove it.
bool adam_accepts(float g) { return (floatBitsToUint(g) & 0x7fffffffu) <= ADAM_LARGEST_BITS; }

// Steps an element and its moments, unless its gradient says nothing.
float adam(AdamStep step, float lr, float g, float param, inout float first, inout float second) {
    precise float m = step.beta1 * first + step.gain1 * g;
    precise float v = step.beta2 * second + step.gain2 * (g * g);
    precise float moved = param - lr * (m * step.inv_bias1) / (sqrt(v) * step.inv_sqrt_bias2 + step.eps);
    const bool ok = adam_accepts(g);
    first = ok ? m : first;
    second = ok ? v : second;
    return ok ? moved : param;
}

#endif
