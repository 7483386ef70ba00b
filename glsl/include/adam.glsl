// Adam's arithmetic, shared by the plain and the fused optimiser pass: the same bits from the same gradient.
#ifndef ADAM_GLSL
#define ADAM_GLSL

const uint ADAM_LARGEST_BITS = 0x5e5e0b6bu;  // 4e18: the square and the sum of moments are still finite

// Parameters of an element's step besides the learning rate.
struct AdamStep {
    float beta1;
    float gain1;           // 1 - beta1, rounded from double precision
    float beta2;
    float gain2;
    float eps;
    float inv_bias1;       // 1 / (1 - beta1^t)
    float inv_sqrt_bias2;  // 1 / sqrt(1 - beta2^t)
};

// Effect of several steps with zero gradient at once: moments are multiplied by `first` and `second`, and the element
// moves by `moved` times one such step without decay.
struct AdamMissed {
    float first;
    float second;
    float moved;
};

float power(float x, uint k) {
    precise float product = 1.0;
    precise float square = x;
    for (uint bit = 0u; bit < 16u; ++bit) {
        product = (k >> bit & 1u) != 0u ? product * square : product;
        square = square * square;
    }
    return product;
}

// In step j, m / sqrt(v) is its initial value times this ratio to the power of j.
float adam_decay(AdamStep step) {
    precise float decay = step.beta1 / sqrt(step.beta2);
    return decay;
}

// The effect of `count` steps, below 2^16: a geometric series.
AdamMissed adam_missed(AdamStep step, uint count) {
    const float decay = adam_decay(step);
    precise float moved = decay * (1.0 - power(decay, count)) / (1.0 - decay);
    return AdamMissed(power(step.beta1, count), power(step.beta2, count), moved);
}

// Makes up for the missed steps, with the current learning rate and bias corrections.
float adam_catch_up(AdamStep step, AdamMissed missed, float lr, float param, inout float first, inout float second) {
    precise float speed = (first * step.inv_bias1) / (sqrt(second) * step.inv_sqrt_bias2 + step.eps);
    precise float moved = param - lr * missed.moved * speed;
    first *= missed.first;
    second *= missed.second;
    return moved;
}

// Tests bits, so that a compiler's assumptions about NaN cannot remove the test.
bool adam_accepts(float g) { return (floatBitsToUint(g) & 0x7fffffffu) <= ADAM_LARGEST_BITS; }

// Steps an element and its moments, unless the gradient is invalid.
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
