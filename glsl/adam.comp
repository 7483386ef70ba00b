#version 460
// adam: one step of Adam (Kingma and Ba 2015) on one attribute plane, epsilon outside the root, as in the 3DGS
// reference. One thread owns one float with its two moments; one workgroup owns 64 consecutive floats. An element whose
// gradient is not finite (or too large to square) stays unchanged, with its moments.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "adam.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Grad { float grad[]; };
layout(set = 0, binding = 2) buffer Param { float param[]; };
layout(set = 0, binding = 3) buffer First { float first[]; };
layout(set = 0, binding = 4) buffer Second { float second[]; };
layout(push_constant) uniform Push {
    uint row;            // floats per splat in this plane
    uint head;           // floats at the start of a row that learn at lr_head
    float lr_head;
    float lr_rest;
    float beta1;
    float gain1;         // 1 - beta1, rounded from double precision
    float beta2;
    float gain2;
    float eps;
    float inv_bias1;     // 1 / (1 - beta1^t)
    float inv_sqrt_bias2;  // 1 / sqrt(1 - beta2^t)
} push;

void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS] * push.row) return;
    const AdamStep step = AdamStep(push.beta1, push.gain1, push.beta2, push.gain2, push.eps, push.inv_bias1, push.inv_sqrt_bias2);
    const float lr = i % push.row < push.head ? push.lr_head : push.lr_rest;
    float m = first[i];
    float v = second[i];
    param[i] = adam(step, lr, grad[i], param[i], m, v);
    first[i] = m;
    second[i] = v;
}
