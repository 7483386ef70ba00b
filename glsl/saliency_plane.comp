#version 460
// saliency_plane: the saliency of a view's pixels, or of a band of its rows, from its soft mask of reduced size. Linear
// between the mask's pixels. One thread owns a pixel; one workgroup owns 64 consecutive pixels.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Mask { uint mask[]; };
layout(set = 0, binding = 1) writeonly buffer Saliency { float saliency[]; };
layout(push_constant) uniform Push {
    uint width;
    uint height;
    uint top;
    uint of_height;
    uint mask_width;
    uint mask_height;
} push;
#include "mask.glsl"

void main() {
    const uint k = global_index();
    if (k >= push.width * push.height) return;
    const uvec2 at = uvec2(k % push.width, push.top + k / push.width);
    saliency[k] = mask_at(at, uvec2(push.width, push.of_height), uvec2(push.mask_width, push.mask_height));
}
