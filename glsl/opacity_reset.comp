#version 460
// opacity_reset: caps every opacity and clears its moments (3DGS, every 3000 steps, to 0.01). One thread owns one
// splat; one workgroup owns 64 consecutive splats.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) buffer Opacities { float opacities[]; };
layout(set = 0, binding = 2) writeonly buffer FirstMoments { float m_opacities[]; };
layout(set = 0, binding = 3) writeonly buffer SecondMoments { float v_opacities[]; };
layout(push_constant) uniform Push { float logit_cap; } push;
void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS]) return;
    if (opacities[i] > push.logit_cap) opacities[i] = push.logit_cap;
    m_opacities[i] = 0.0;
    v_opacities[i] = 0.0;
}
