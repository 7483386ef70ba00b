#version 460
// crop_pair: copies the same window of a render and of its photograph into one buffer for the perceptual distance. One
// thread owns a pixel of the window; one workgroup owns 64 consecutive pixels. At masked pixels of the photograph
// (alpha 0) the render counts as equal.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "divide.glsl"
#include "loads.glsl"
#include "unorm.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Image { vec4 image[]; };
layout(set = 0, binding = 1) readonly buffer Target { uint target[]; };
layout(set = 0, binding = 2) writeonly buffer Pair { vec4 pair[]; };
layout(push_constant) uniform Push {
    uint image_width;  // of the photograph
    uint left;
    uint top;
    uint width;  // of the window
    uint height;
    uint cropped; // 1: the render covers only the window
} push;

void main() {
    const uint pixel = global_index();
    const uint pixels = push.width * push.height;
    if (pixel >= pixels) return;
    const uint y = quotient(pixel, push.width);
    const uint at = (push.top + y) * push.image_width + push.left + pixel - y * push.width;
    const uint photograph = target[at];
    const uint from = push.cropped != 0u ? pixel : at;
    const vec3 there = unorm8(photograph);
    pair[pixel] = vec4(photograph >> 24 == 0u ? there : LOAD4(image, from).rgb, 0.0);
    pair[pixels + pixel] = vec4(there, 0.0);
}
