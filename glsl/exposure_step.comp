#version 460
// exposure_step: sums the parts of the gradient of a photograph's 12 numbers, takes a step of Adam with the difference
// from the mean of all photographs' last gradients, and updates the mean deviation. One workgroup. Thread t below 60
// sums every 5th part and every 5th photograph of number t % 12, in order; thread t below 12 owns step and mean of
// number t.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "adam.glsl"
#include "exposure.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer ExposureParts { float exposure_parts[]; };
layout(set = 0, binding = 1) buffer Exposures { float exposures[]; };
layout(push_constant) uniform Push {
    uint parts;  // rows of 12 in exposure_parts
    uint view;   // row of the photograph
    uint views;  // photographs
    uint known;  // photographs with a last gradient, including this photograph
    float lr;
    float beta1;
    float gain1;           // 1 - beta1, rounded from double precision
    float beta2;
    float gain2;
    float eps;
    float inv_bias1;       // 1 / (1 - beta1^t)
    float inv_sqrt_bias2;  // 1 / sqrt(1 - beta2^t)
} push;

shared float sums[64];
shared float fresh[12];

void main() {
    const uint t = local_index();
    const uint k = t % EXPOSURE_NUMBERS;
    const uint run = t / EXPOSURE_NUMBERS;
    const bool owner = t < EXPOSURE_NUMBERS && group_index() == 0u;
    const uint end = run < 5u ? 1u : 0u;
    float sum = 0.0;
    for (uint i = run; i < push.parts * end; i += 5u) sum += exposure_parts[EXPOSURE_NUMBERS * i + k];
    sums[t] = sum;
    barrier();
    const uint at = EXPOSURE_ROW * push.view + t;
    float grad = 0.0;
    bool told = false;
    if (owner) {
        for (uint i = 0u; i < 5u; ++i) grad += sums[EXPOSURE_NUMBERS * i + t];
        told = adam_accepts(grad);
        fresh[t] = told ? grad : exposures[at + 3u * EXPOSURE_NUMBERS];
        exposures[at + 3u * EXPOSURE_NUMBERS] = fresh[t];
    }
    barrier();
    sum = 0.0;
    for (uint i = run; i < push.views * end; i += 5u) {
        sum += i == push.view ? fresh[k] : exposures[EXPOSURE_ROW * i + 3u * EXPOSURE_NUMBERS + k];
    }
    sums[t] = sum;
    barrier();
    if (owner) {
        float mean_grad = 0.0;
        for (uint i = 0u; i < 5u; ++i) mean_grad += sums[EXPOSURE_NUMBERS * i + t];
        mean_grad /= float(push.known);
        const AdamStep step = AdamStep(push.beta1, push.gain1, push.beta2, push.gain2, push.eps, push.inv_bias1, push.inv_sqrt_bias2);
        float m = exposures[at + EXPOSURE_NUMBERS];
        float v = exposures[at + 2u * EXPOSURE_NUMBERS];
        const float moved = adam(step, push.lr, told ? grad - mean_grad : grad, exposures[at], m, v);
        exposures[at] = moved;
        exposures[at + EXPOSURE_NUMBERS] = m;
        exposures[at + 2u * EXPOSURE_NUMBERS] = v;
        fresh[t] = moved;
    }
    barrier();
    sum = 0.0;
    for (uint i = run; i < push.views * end; i += 5u) {
        sum += i == push.view ? fresh[k] : exposures[EXPOSURE_ROW * i + k];
    }
    sums[t] = sum;
    barrier();
    if (owner) {
        float total = 0.0;
        for (uint i = 0u; i < 5u; ++i) total += sums[EXPOSURE_NUMBERS * i + t];
        exposures[EXPOSURE_ROW * push.views + t] = total / float(push.views);
    }
}
