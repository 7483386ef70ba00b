// A pixel of the photograph; include after the declaration of `target`. A pixel whose alpha is 0 is masked.
#ifndef PHOTOGRAPH_GLSL
#define PHOTOGRAPH_GLSL

#include "unorm.glsl"

// Bits per channel: 8 (a word per pixel, red lowest) or 16 (two words: red and green, blue and alpha, the lower half
// first).
layout(constant_id = 2) const uint PHOTOGRAPH_BITS = 8u;

struct Seen {
    vec3 colour;
    bool counts;
};

Seen photograph_at(uint k) {
    if (PHOTOGRAPH_BITS == 16u) {
        const uint blue_alpha = target[2u * k + 1u];
        return Seen(unorm16(target[2u * k], blue_alpha), blue_alpha >> 16 != 0u);
    }
    const uint rgba = target[k];
    return Seen(unorm8(rgba), rgba >> 24 != 0u);
}

#endif
