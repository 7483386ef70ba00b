#version 460
// exposure_apply: the render under a photograph's exposure, for the loss. One thread owns 16 pixels, every 64th of the
// 1024 consecutive pixels of its workgroup.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common.glsl"
#include "exposure.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Image { vec4 image[]; };
layout(set = 0, binding = 1) readonly buffer Exposures { float exposures[]; };
layout(set = 0, binding = 2) writeonly buffer Exposed { vec4 exposed[]; };
layout(push_constant) uniform Push {
    uint pixels;
    uint view;   // row of the photograph
    uint views;  // photographs
} push;

void main() {
    float e[12];
    [[unroll]] for (uint k = 0u; k < EXPOSURE_NUMBERS; ++k) {
        e[k] = exposures[EXPOSURE_ROW * push.view + k] - exposures[EXPOSURE_ROW * push.views + k];
    }
    const uint first = group_index() * EXPOSURE_PIXELS + local_index();
    for (uint i = 0u; i < EXPOSURE_PIXELS; i += 64u) {
        if (first + i < push.pixels) {
            const vec4 c = image[first + i];
            // The identity is added last: an untrained exposure changes no bit.
            exposed[first + i] = c + vec4(
                e[0] * c.r + e[1] * c.g + e[2] * c.b + e[3],
                e[4] * c.r + e[5] * c.g + e[6] * c.b + e[7],
                e[8] * c.r + e[9] * c.g + e[10] * c.b + e[11],
                0.0);
        }
    }
}
