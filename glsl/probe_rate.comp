#version 460
// probe_rate: arithmetic on registers only, to measure the device's arithmetic rate. Writes one sum per thread. One
// thread owns eight independent chains of operations, like the eight pixels of a thread in the blending passes; a
// workgroup has the size of the blending passes' workgroups on the device. x <- x a + b, or x <- 2^-x with EXP2.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common.glsl"
layout(local_size_x = 8, local_size_x_id = 0) in;
layout(constant_id = 1) const uint EXP2 = 0u;  // 1: exponentials in place of multiply-adds
layout(set = 0, binding = 0) writeonly buffer Sums { float sums[]; };
layout(push_constant) uniform Push {
    uint turns;    // of UNROLL operations in every chain, at most 65,535
    uint threads;  // that write a sum
    float a;
    float b;
} push;

const uint CHAINS = 8u;
const uint UNROLL = 8u;

#define TURNS(operation) \
    for (uint turn = 0u; turn < push.turns; ++turn) { \
        [[unroll]] for (uint u = 0u; u < UNROLL; ++u) { \
            [[unroll]] for (uint j = 0u; j < CHAINS; ++j) x[j] = operation; \
        } \
    }

void main() {
    const uint thread = global_index();
    float x[CHAINS];
    [[unroll]] for (uint j = 0u; j < CHAINS; ++j) x[j] = float((thread + j) % 16u) * 0.0625;
    // The choice stands outside of the loops: a compiler that keeps it must not keep it in every operation.
    if (EXP2 != 0u) {
        TURNS(exp2(-x[j]))
    } else {
        TURNS(x[j] * push.a + push.b)
    }
    float sum = 0.0;
    [[unroll]] for (uint j = 0u; j < CHAINS; ++j) sum += x[j];
    if (thread < push.threads) sums[thread] = sum;
}
