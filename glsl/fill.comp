#version 460
// fill: writes one value to a range of words.
// One thread owns one word; one workgroup owns 64 consecutive words.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) writeonly buffer Target { uint target[]; };
layout(push_constant) uniform Push { uint count; uint value; } push;
void main() {
    const uint i = global_index();
    if (i < push.count) target[i] = push.value;
}
