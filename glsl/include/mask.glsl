// A mask of bytes, four in a word, row after row without padding; include after the declaration of `mask`.
#ifndef MASK_GLSL
#define MASK_GLSL
#include "place.glsl"

float mask_byte(uint x, uint y, uint width) {
    const uint k = y * width + x;
    return float(mask[k / 4u] >> 8u * (k % 4u) & 0xffu);
}

// From 0 to 1 at a pixel of the image, linear between the mask's pixels.
float mask_at(uvec2 at, uvec2 picture, uvec2 size) {
    const Place p = place_in(at, picture, size);
    const float above = mix(mask_byte(p.low.x, p.low.y, size.x), mask_byte(p.high.x, p.low.y, size.x), p.share.x);
    const float below = mix(mask_byte(p.low.x, p.high.y, size.x), mask_byte(p.high.x, p.high.y, size.x), p.share.x);
    return mix(above, below, p.share.y) / 255.0;
}

#endif
