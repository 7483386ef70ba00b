// Shared by the variants of the blend backward pass: bindings, sums of gradients, and a pixel's backward walk through
// the tile's list. To be included after the shape (blend_column.glsl or blend_pixel.glsl). SLOTS: a row of partial sums
// per (splat, tile) pair, written once and summed in a fixed order; slot_sum adds the rows. ATOMIC, CAS: sums are added
// to the splat's row by native float atomics, or by compare-and-swap.
#ifndef BLEND_BACKWARD_GLSL
#define BLEND_BACKWARD_GLSL

layout(constant_id = 2) const uint ABS = 1u;                    // 1: sums of absolute values of the mean's gradient too
layout(constant_id = 3) const uint CLAMP_GRADIENT_PASSES = 0u;  // 1: pass the gradient through min(0.99, alpha)

layout(set = 0, binding = 0) readonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 1) readonly buffer Normals { vec4 normals[]; };
layout(set = 0, binding = 2) readonly buffer SortedSplats { uint sorted_splats[]; };
layout(set = 0, binding = 3) readonly buffer TileRanges { uvec2 tile_ranges[]; };
layout(set = 0, binding = 4) readonly buffer Image { vec4 image[]; };
layout(set = 0, binding = 5) readonly buffer Last { uint last_places[]; };
layout(set = 0, binding = 6) readonly buffer GradImage { vec4 grad_image[]; };
layout(set = 0, binding = 7) readonly buffer GradAux { vec4 grad_aux_image[]; };
#ifdef SLOTS
layout(set = 0, binding = 8) readonly buffer SortedSlots { uint sorted_slots[]; };
layout(set = 0, binding = 9) buffer SlotGrads { float slot_grads[]; };
layout(set = 0, binding = 10) writeonly buffer SlotNormals { float slot_normals[]; };
layout(set = 0, binding = 11) buffer PairCounts { uint pair_counts[]; };
#else
#ifdef CAS
#define WORD uint
#else
#define WORD float
#endif
layout(set = 0, binding = 8) buffer Grad2d { WORD grad2d[]; };
layout(set = 0, binding = 9) buffer GradNormals { WORD grad_normals[]; };
layout(set = 0, binding = 10) buffer PairCounts { uint pair_counts[]; };
#endif

const float TWO_LN_2 = 1.38629436;

Splat load_splat(uint i) {
    const vec4 p = LOAD4(splat2d, 3u * i);
    const vec4 q = LOAD4(splat2d, 3u * i + 1u);
    const vec4 colour = LOAD4(splat2d, 3u * i + 2u);
    const vec3 factor = conic_factor(p.z, p.w, q.w);
    const vec4 normal = AUX != 0u ? LOAD4(normals, i) : vec4(0.0);
    return Splat(p.x, p.y, factor.x, factor.y, factor.z, q.y, q.z, colour.rgb, normal.xyz, vec2(colour.w, normal.w));
}

// The row for the sums of a pair: the slot's row, or the splat's row.
uint row_of(uint pair) {
#ifdef SLOTS
    return sorted_slots[pair];
#else
    return sorted_splats[pair];
#endif
}

#ifdef SLOTS
// The same row, after prefetching its first and last word. Rows are far apart: a store to a line outside the cache
// delays all later stores, one row after the other, while loads of all lanes of a subgroup wait together. The loaded
// words are not needed, but without an effect on the row the compiler would remove the loads; images are never 0 wide.
uint prefetch_row(uint row) {
    const uint words = floatBitsToUint(slot_grads[12u * row]) ^ floatBitsToUint(slot_grads[12u * row + 11u]);
    return row + (push.width == 0u ? words : 0u);
}
#endif

#ifdef CAS
#define ADD(buffer, index, value)                                                                           \
    {                                                                                                       \
        uint seen = buffer[index];                                                                          \
        uint expected;                                                                                      \
        do {                                                                                                \
            expected = seen;                                                                                \
            seen = atomicCompSwap(buffer[index], expected, floatBitsToUint(uintBitsToFloat(expected) + value)); \
        } while (seen != expected);                                                                         \
    }
#endif

// Column `column` of a row: 0 to 11 for grad2d, 12 to 14 (AUX only) for the normal.
void store_grad(uint row, uint column, float value) {
#ifdef SLOTS
    if (column < 12u) slot_grads[12u * row + column] = value;
    else if (AUX != 0u) slot_normals[4u * row + column - 12u] = value;
#else
    if (value == 0.0) return;
#ifdef CAS
    if (column < 12u) ADD(grad2d, 12u * row + column, value)
    else if (AUX != 0u) ADD(grad_normals, 4u * row + column - 12u, value)
#else
    if (column < 12u) atomicAdd(grad2d[12u * row + column], value);
    else if (AUX != 0u) atomicAdd(grad_normals[4u * row + column - 12u], value);
#endif
#endif
}

// State of a pixel in the backward walk. `behind` is dL/d(colour) dotted with the colour behind the current splat,
// including the background and the gradient of the final transmittance. With `behind`, dL/d(alpha) = T (c . g - behind)
// needs no division.
struct Pixel {
    float transmittance;
    float behind;
    vec3 grad;
    vec4 grad_aux;
    uint last;
};

uint evaluated = 0u;
uint blended = 0u;

Pixel load_pixel(uvec2 at, bool inside) {
    Pixel pixel = Pixel(1.0, 0.0, vec3(0.0), vec4(0.0), 0u);
    if (inside) {
        const uint k = at.y * push.width + at.x;
        const vec4 grad = LOAD4(grad_image, k);
        pixel.transmittance = LOAD4(image, k).w;
        pixel.grad = grad.rgb;
        pixel.behind = dot(grad.rgb, vec3(push.red, push.green, push.blue)) + grad.w;
        if (AUX != 0u) pixel.grad_aux = LOAD4(grad_aux_image, k);
        pixel.last = last_places[k];
    }
    return pixel;
}

// A splat's contribution at one pixel: the weight in the blended channels, and dL/d(exponent, base e).
struct Share {
    float weight;
    float v;
};

// Moves a pixel back to the front of a splat, whose depth at the pixel is `depth`. `reached`: the splat is not after the
// pixel's last contributor.
Share step_back(inout float transmittance, inout float behind, vec3 grad, vec4 grad_aux, Splat s, float power,
                float depth, bool reached) {
    float unclamped = unclamped_alpha(power, s.opacity);
    unclamped = reached ? unclamped : 0.0;
    const float alpha = min(unclamped, ALPHA_MAX);
    transmittance = transmittance / (1.0 - alpha);
    const float weight = alpha * transmittance;
    float here = dot(s.colour, grad);
    if (AUX != 0u) here += dot(vec4(depth, s.normal), grad_aux);
    const float difference = here - behind;
    behind += alpha * difference;
    const float passed = CLAMP_GRADIENT_PASSES != 0u ? unclamped * transmittance : unclamped > ALPHA_MAX ? 0.0 : weight;
    return Share(weight, passed * difference);
}

#endif
