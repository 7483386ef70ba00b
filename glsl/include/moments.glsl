// Moments of the optimiser as floats, and steps with them. `element` is a parameter's number among the splat's 59.
// STEP3 steps a row of three, STEP4 a row of four.
#ifndef MOMENTS_GLSL
#define MOMENTS_GLSL

layout(set = 0, binding = 13) buffer MMeans { float m_means[]; };
layout(set = 0, binding = 14) buffer MQuats { vec4 m_quats[]; };
layout(set = 0, binding = 15) buffer MScales { float m_scales[]; };
layout(set = 0, binding = 16) buffer MOpacities { float m_opacities[]; };
layout(set = 0, binding = 17) buffer MSh0 { vec4 m_sh0[]; };
layout(set = 0, binding = 18) buffer MSh1 { vec4 m_sh1[]; };
layout(set = 0, binding = 19) buffer MSh2 { vec4 m_sh2[]; };
layout(set = 0, binding = 20) buffer MSh3 { vec4 m_sh3[]; };
layout(set = 0, binding = 21) buffer VMeans { float v_means[]; };
layout(set = 0, binding = 22) buffer VQuats { vec4 v_quats[]; };
layout(set = 0, binding = 23) buffer VScales { float v_scales[]; };
layout(set = 0, binding = 24) buffer VOpacities { float v_opacities[]; };
layout(set = 0, binding = 25) buffer VSh0 { vec4 v_sh0[]; };
layout(set = 0, binding = 26) buffer VSh1 { vec4 v_sh1[]; };
layout(set = 0, binding = 27) buffer VSh2 { vec4 v_sh2[]; };
layout(set = 0, binding = 28) buffer VSh3 { vec4 v_sh3[]; };
// Rows of four numbers; the last belongs to the optimiser: see begin_splat.
layout(set = 0, binding = 29) buffer Stats { float stats[]; };

#define STEP1(plane, first, second, at, element, step, lr, g, old)     \
    {                                                                  \
        float m = first[at], v = second[at];                           \
        plane[at] = adam1(step, lr, g, old, m, v);                     \
        first[at] = m;                                                 \
        second[at] = v;                                                \
    }
#define STEP3(plane, first, second, element, lr, g, old)               \
    {                                                                  \
        vec3 m = LOAD3(first, i), v = LOAD3(second, i);                \
        const vec3 gradient = g;                                       \
        plane[s] = adam1(step, lr, gradient.x, (old).x, m.x, v.x);     \
        plane[s + 1u] = adam1(step, lr, gradient.y, (old).y, m.y, v.y); \
        plane[s + 2u] = adam1(step, lr, gradient.z, (old).z, m.z, v.z); \
        first[s] = m.x;                                                \
        first[s + 1u] = m.y;                                           \
        first[s + 2u] = m.z;                                           \
        second[s] = v.x;                                               \
        second[s + 1u] = v.y;                                          \
        second[s + 2u] = v.z;                                          \
    }
#define STEP4(plane, first, second, at, element, lr, g, old)           \
    {                                                                  \
        vec4 m = LOAD4(first, at), v = LOAD4(second, at);              \
        plane[at] = adam4(step, lr, g, old, m, v);                     \
        first[at] = m;                                                 \
        second[at] = v;                                                \
    }

#endif
