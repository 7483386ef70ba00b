#version 460
// probe_copy: copies four words at a time, to measure how fast the device moves bytes.
// One thread owns four groups of four words, 64 groups apart; a workgroup owns 256 consecutive groups.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Source { uvec4 source[]; };
layout(set = 0, binding = 1) writeonly buffer Target { uvec4 target[]; };
layout(push_constant) uniform Push { uint count; } push;  // groups of four words

const uint EACH = 4u;

void main() {
    const uint first = group_index() * 64u * EACH + local_index();
    [[unroll]] for (uint i = 0u; i < EACH; ++i) {
        const uint k = first + 64u * i;
        if (k < push.count) target[k] = source[k];
    }
}
