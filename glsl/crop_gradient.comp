#version 460
// crop_gradient: adds the gradient of a perceptual distance, times a weight, to the gradient of the render. One thread
// owns a pixel of the window; one workgroup owns 64 consecutive pixels. The gradient comes in blocks of 2x2 pixels,
// row-major, four floats to a pixel; a masked pixel (alpha 0 in the photograph) gets none.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "divide.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Blocks { vec4 blocks[]; };
layout(set = 0, binding = 1) readonly buffer Target { uint target[]; };
layout(set = 0, binding = 2) buffer GradImage { vec4 grad_image[]; };
layout(push_constant) uniform Push {
    uint image_width;  // of the photograph
    uint left;
    uint top;
    uint width;  // of the window
    uint height;
    float weight;
    uint cropped; // 1: the render covers only the window
} push;

void main() {
    const uint pixel = global_index();
    if (pixel >= push.width * push.height) return;
    const uint y = quotient(pixel, push.width);
    const uint x = pixel - y * push.width;
    const uint at = (push.top + y) * push.image_width + push.left + x;
    const uint block = (y / 2u) * ((push.width + 1u) / 2u) + x / 2u;
    const vec4 grad = LOAD4(blocks, 4u * block + 2u * (y & 1u) + (x & 1u));
    const uint to = push.cropped != 0u ? pixel : at;
    if (target[at] >> 24 != 0u) grad_image[to] = LOAD4(grad_image, to) + vec4(push.weight * grad.rgb, 0.0);
}
