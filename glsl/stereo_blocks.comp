#version 460
// stereo_blocks: a photograph's luma as a row of four per pixel: the pixel, its right neighbour, and the two below
// them, so that a bilinear sample is one load. Beyond the right and the lower edge the last column and row repeat. One
// thread owns a pixel; one workgroup owns 64 consecutive pixels.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "divide.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Luma { float luma[]; };
layout(set = 0, binding = 1) writeonly buffer Blocks { vec4 blocks[]; };
layout(push_constant) uniform Push {
    uint width;
    uint height;
    uint first;  // row of the first pixel
} push;

void main() {
    const uint pixel = global_index();
    if (pixel >= push.width * push.height) return;
    const uint y = quotient(pixel, push.width);
    const uint x = pixel - y * push.width;
    const uint right = min(x + 1u, push.width - 1u);
    const uint here = y * push.width;
    const uint below = min(y + 1u, push.height - 1u) * push.width;
    blocks[push.first + pixel] = vec4(luma[here + x], luma[here + right], luma[below + x], luma[below + right]);
}
