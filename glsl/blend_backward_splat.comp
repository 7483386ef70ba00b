#version 460
// blend_backward_splat: the gradients of blend_backward's PIXEL shape with no reduction over pixels: threads own splats.
// Idea: per-splat parallel backward, Taming 3DGS (Mallick et al. 2024).
//
// A workgroup of 256 threads owns a tile of 16x16 pixels and takes its list from the back in batches of 256 splats. In a batch
//  1. each thread owns a pixel: it takes it past the batch's splats, and notes its state (transmittance, what lies behind) before
//     each bucket of 32 splats in shared memory;
//  2. each thread owns a splat of the batch, 32 consecutive threads a bucket: pixel after pixel passes through the bucket's threads,
//     thread k holding pixel i - k at turn i, and each thread adds up what its splat gets from all 256 pixels.
// The states are computed anew here instead of being stored by the forward pass, which would take 128 bytes per pair (256 with depth
// and normals), and they come from the back: a difference of the image and the colour in front, as a state stored by the forward
// pass would need, has no digits left behind a saturated stack.
// Within a bucket states are handed on by shuffles where a subgroup holds a bucket, else in place in shared memory. The order of
// every sum is that of the pixels, whatever the width.
// slots, atomic, cas: see blend_backward.glsl; either way one addition per column, splat and tile.
//! variant slots SLOTS
//! variant atomic ATOMIC
//! variant cas CAS
//! variant emulated_slots SLOTS SUBGROUP_EMULATED
//! variant emulated_cas CAS SUBGROUP_EMULATED
#extension GL_GOOGLE_include_directive : require
#ifdef ATOMIC
#extension GL_EXT_shader_atomic_float : require
#endif
#define WITH_SUBGROUPS
#include "blend_pixel.glsl"
#include "blend_backward.glsl"

const uint BUCKET = 32u;
const uint BUCKETS = LOCAL_SIZE / BUCKET;
const uint UNROLL = 4u;
const uint NOWHERE = 0xffffffffu;

// By bucket of the batch and pixel of the tile (row-major): transmittance, behind; see `Pixel`.
shared vec2 states[BUCKETS * LOCAL_SIZE];
shared vec4 grads_aux[LOCAL_SIZE];
shared vec3 grads[LOCAL_SIZE];
shared uint lasts[LOCAL_SIZE];
shared Splat staged[BUCKET];
shared uint most;

// Sums over the pixels of a tile, for one splat.
struct Sums {
    vec2 mean;
    vec3 conic;
    float v;
    vec3 color;
    vec4 aux;
    vec2 abs_mean;
};

void store_sums(uint row, Sums sums, float opacity_inverse) {
    put(row, 0u, TWO_LN_2 * sums.mean.x);
    put(row, 1u, TWO_LN_2 * sums.mean.y);
    put(row, 2u, -0.5 * sums.conic.x);
    put(row, 3u, -sums.conic.y);
    put(row, 4u, -0.5 * sums.conic.z);
    put(row, 5u, sums.v * opacity_inverse);
    put(row, 6u, sums.color.r);
    put(row, 7u, sums.color.g);
    put(row, 8u, sums.color.b);
    put(row, 9u, sums.aux.x);
    put(row, 10u, TWO_LN_2 * sums.abs_mean.x);
    put(row, 11u, TWO_LN_2 * sums.abs_mean.y);
    put(row, 12u, sums.aux.y);
    put(row, 13u, sums.aux.z);
    put(row, 14u, sums.aux.w);
}

// The roots of a splat's exponent at d = pixel centre - mean, as blend_forward's PIXEL shape computes them.
vec2 roots_at(Splat s, vec2 d) {
    precise float along = s.p * d.x;
    return conic_roots(along, s.q, s.r, d.y);
}

void main() {
    const uint tile = group_index();
    const bool real = tile < tile_total(SIDE);
    const uvec2 range = real ? tile_ranges[tile] : uvec2(0u);
    const uvec2 corner = tile_corner(tile, SIDE);
    // A bucket's threads are consecutive lanes of a subgroup wherever it holds as many.
    const uint rank = workgroup_rank();
    const uint bucket = rank / BUCKET;
    const uint lane = rank % BUCKET;
    const bool by_shuffle = subgroup_width() >= BUCKET;

    const uvec2 own = pixel_place(rank);
    const uint cell = own.y * SIDE + own.x;
    const uvec2 at = corner + own;
    const vec2 center = vec2(at) + 0.5;
    Pixel pixel = load_pixel(at, real && at.x < push.width && at.y < push.height);
    grads[cell] = pixel.grad;
    if (AUX != 0u) grads_aux[cell] = pixel.grad_aux;
    lasts[cell] = pixel.last;
    if (rank == 0u) most = 0u;
    barrier();
    atomicMax(most, pixel.last);
    barrier();
    const uint top = min(most, range.y - range.x);

#ifdef SLOTS
    for (uint i = range.x + top + rank; i < range.y; i += LOCAL_SIZE) {
        store_sums(row_of(i), Sums(vec2(0.0), vec3(0.0), 0.0, vec3(0.0), vec4(0.0), vec2(0.0)), 0.0);
    }
#endif

    for (uint left = top; left > 0u; left -= min(left, LOCAL_SIZE)) {
        const uint n = min(left, LOCAL_SIZE);
        const uint pair = range.x + left - 1u - min(rank, n - 1u);
        Splat mine = load_splat(sorted_splats[pair]);
        mine.opacity = rank < n ? mine.opacity : 0.0;

        for (uint b = 0u; b * BUCKET < n; ++b) {
            barrier();
            if (bucket == b) staged[lane] = mine;
            barrier();
            states[b * LOCAL_SIZE + cell] = vec2(pixel.transmittance, pixel.behind);
            for (uint k0 = 0u; k0 < BUCKET; k0 += UNROLL) {
                [[unroll]] for (uint u = 0u; u < UNROLL; ++u) {
                    const Splat s = staged[k0 + u];
                    // Past the end of the list opacities are 0, so it does not matter that the place wraps.
                    const bool reached = left - b * BUCKET - k0 - u <= pixel.last;
                    step_back(pixel.transmittance, pixel.behind, pixel.grad, pixel.grad_aux, s,
                        exponent(roots_at(s, center - vec2(s.x, s.y))), reached);
                }
            }
        }
        barrier();

        const uint place = rank < n ? left - rank : NOWHERE;
        Sums sums = Sums(vec2(0.0), vec3(0.0), 0.0, vec3(0.0), vec4(0.0), vec2(0.0));
        vec2 handed = vec2(1.0, 0.0);
        uint turns = LOCAL_SIZE + BUCKET - 1u;
#ifndef SUBGROUP_EMULATED
        // A subgroup without a splat has no barrier to reach.
        if (by_shuffle && rank - subgroup_lane() >= n) turns = 0u;
#endif
        for (uint turn = 0u; turn < turns; ++turn) {
            // The unsigned difference wraps where no pixel has come yet.
            const uint i = turn - lane;
            const bool here = i < LOCAL_SIZE;
            const uint p = here ? i : 0u;
            const uint slot = bucket * LOCAL_SIZE + p;
            vec2 state = handed;
            if (!by_shuffle || lane == 0u) state = states[slot];
            const vec3 grad = grads[p];
            const vec4 grad_aux = AUX != 0u ? grads_aux[p] : vec4(0.0);
            const vec2 d = vec2(corner + uvec2(p % SIDE, p / SIDE)) + 0.5 - vec2(mine.x, mine.y);
            const bool reached = here && place <= lasts[p];
            const vec2 roots = roots_at(mine, d);
            const Share share = step_back(state.x, state.y, grad, grad_aux, mine, exponent(roots), reached);
            const vec2 slope = vec2(mine.p * roots.x, mine.q * roots.x + mine.r * roots.y);
            sums.mean += share.v * slope;
            const vec2 vd = share.v * d;
            sums.conic += vec3(vd.x * d.x, vd.x * d.y, vd.y * d.y);
            sums.v += share.v;
            sums.color += share.weight * grad;
            if (AUX != 0u) sums.aux += share.weight * grad_aux;
            if (ABS != 0u) sums.abs_mean += abs(share.v * slope);
            if (COUNT != 0u) {
                evaluated += reached ? 1u : 0u;
                blended += share.weight > 0.0 ? 1u : 0u;
            }
            if (by_shuffle) {
                const uint before = max(subgroup_lane(), 1u) - 1u;
                handed = vec2(subgroup_shuffle(state.x, before), subgroup_shuffle(state.y, before));
            } else {
                if (here) states[slot] = state;
                barrier();
            }
        }
        if (rank < n) store_sums(row_of(pair), sums, mine.opacity > 0.0 ? 1.0 / mine.opacity : 0.0);
    }
    if (COUNT != 0u) {
        atomicAdd(pair_counts[BACKWARD_EVALUATED], evaluated);
        atomicAdd(pair_counts[BACKWARD_BLENDED], blended);
    }
}
