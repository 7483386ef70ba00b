// Both moments of Adam in one word. The upper half is the second moment v: the exponent and eight bits of the mantissa
// of its f32 (it has no sign), rounded up or down at random. The lower half is m / sqrt(v) as a half float, which Adam
// bounds by 7.3.
//
// v changes by a thousandth per step, less than half a unit in the last place, so rounding to nearest would never
// change v. Random rounding is unbiased. m changes by a tenth of the difference and may be rounded to nearest.
#ifndef PACKED_MOMENTS_GLSL
#define PACKED_MOMENTS_GLSL
#include "random.glsl"

layout(set = 0, binding = 13) buffer MomentsMeans { uint m_means[]; };
layout(set = 0, binding = 14) buffer MomentsQuats { uvec4 m_quats[]; };
layout(set = 0, binding = 15) buffer MomentsScales { uint m_scales[]; };
layout(set = 0, binding = 16) buffer MomentsOpacities { uint m_opacities[]; };
layout(set = 0, binding = 17) buffer MomentsSh0 { uvec4 m_sh0[]; };
layout(set = 0, binding = 18) buffer MomentsSh1 { uvec4 m_sh1[]; };
layout(set = 0, binding = 19) buffer MomentsSh2 { uvec4 m_sh2[]; };
layout(set = 0, binding = 20) buffer MomentsSh3 { uvec4 m_sh3[]; };
// Rows of four numbers; the last belongs to the optimiser: see begin_splat.
layout(set = 0, binding = 21) buffer Stats { float stats[]; };

const uint V_SHIFT = 15u;  // bits of v's f32 that are dropped
const uint V_LOST = 0x7fffu;

// Random bits of elements element .. element + 3 of splat i; the step stands in the upper half of the flags.
uvec4 dither4(uint i, uint flags, uint element) {
    return random_bits(uvec4(i, flags >> 16u, element, 0x5eedu)) >> (32u - V_SHIFT);
}
uint dither(uint i, uint flags, uint element) { return dither4(i, flags, element).x; }

uint pack_moments(float m, float v, uint bits) {
    const uint kept = (floatBitsToUint(v) + bits) >> V_SHIFT;
    const float root = sqrt(uintBitsToFloat(kept << V_SHIFT));
    const float ratio = kept != 0u ? m / root : 0.0;
    return kept << 16u | packHalf2x16(vec2(ratio, 0.0));
}

void unpack_moments(uint word, out float m, out float v) {
    v = uintBitsToFloat(word >> 16u << V_SHIFT);
    m = unpackHalf2x16(word).x * sqrt(v);
}

uvec4 pack_moments(vec4 m, vec4 v, uvec4 bits) {
    return uvec4(pack_moments(m.x, v.x, bits.x), pack_moments(m.y, v.y, bits.y), pack_moments(m.z, v.z, bits.z),
                 pack_moments(m.w, v.w, bits.w));
}

void unpack_moments(uvec4 words, out vec4 m, out vec4 v) {
    unpack_moments(words.x, m.x, v.x);
    unpack_moments(words.y, m.y, v.y);
    unpack_moments(words.z, m.z, v.z);
    unpack_moments(words.w, m.w, v.w);
}

// As in moments.glsl; `second` is not used.
#define STEP1(plane, first, second, at, element, step, lr, g, old)                   \
    {                                                                                \
        float m, v;                                                                  \
        unpack_moments(first[at], m, v);                                             \
        plane[at] = adam1(step, lr, g, old, m, v);                                   \
        first[at] = pack_moments(m, v, dither(i, push.flags, element));              \
    }
#define STEP3(plane, first, second, element, lr, g, old)                             \
    STEP1(plane, first, second, s, element, step, lr, (g).x, (old).x)                \
    STEP1(plane, first, second, s + 1u, element + 1u, step, lr, (g).y, (old).y)      \
    STEP1(plane, first, second, s + 2u, element + 2u, step, lr, (g).z, (old).z)
#define STEP4(plane, first, second, at, element, lr, g, old)                         \
    {                                                                                \
        vec4 m, v;                                                                   \
        unpack_moments(LOAD4(first, at), m, v);                                      \
        plane[at] = adam4(step, lr, g, old, m, v);                                   \
        first[at] = pack_moments(m, v, dither4(i, push.flags, element));             \
    }

#endif
