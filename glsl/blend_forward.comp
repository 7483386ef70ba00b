#version 460
// blend_forward: alpha-blends every tile's splats front to back into image, aux and last. column: one thread owns a
// column of 8 pixels, one workgroup (8 threads) a tile of 8x8. pixel: one thread owns a pixel, one workgroup (256
// threads) a tile of 16x16; with BLOCK, splats that do not show in a block of pixels are left out there.
//! variant column COLUMN
//! variant column_emulated COLUMN SUBGROUP_EMULATED
//! variant pixel PIXEL
//! texels(COLUMN)
#extension GL_GOOGLE_include_directive : require
#ifdef COLUMN
#include "blend_column.glsl"
#else
#include "blend_pixel.glsl"
#include "blocks.glsl"
#endif

layout(constant_id = 5) const uint WEIGHTS = 0u;  // 1: keep the largest weight of every splat in any pixel

layout(set = 0, binding = 0) readonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 1) readonly buffer Normals { vec4 normals[]; };
layout(set = 0, binding = 2) readonly buffer SortedSplats { uint sorted_splats[]; };
layout(set = 0, binding = 3) readonly buffer TileRanges { uvec2 tile_ranges[]; };
layout(set = 0, binding = 4) writeonly buffer Image { vec4 image[]; };
layout(set = 0, binding = 5) writeonly buffer Aux { vec4 aux_image[]; };
layout(set = 0, binding = 6) writeonly buffer Last { uint last_places[]; };
layout(set = 0, binding = 7) buffer PairCounts { uint pair_counts[]; };
layout(set = 0, binding = 8) buffer Weights { uint weights[]; };

Splat load_splat(uint i) {
    const vec4 p = LOAD4(splat2d, 3u * i);
    const vec4 q = LOAD4(splat2d, 3u * i + 1u);
    const vec4 colour = LOAD4(splat2d, 3u * i + 2u);
    const vec3 factor = conic_factor(p.z, p.w, q.w);
    const vec4 normal = AUX != 0u ? LOAD4(normals, i) : vec4(0.0);
    return Splat(p.x, p.y, factor.x, factor.y, factor.z, q.y, q.z, colour.rgb, normal.xyz, vec2(colour.w, normal.w));
}

// State of a pixel in the loop over the list. A stopped pixel keeps its transmittance with a minus sign.
struct Pixel {
    float transmittance;
    vec3 colour;
    vec4 aux;
    uint last;
};

uint evaluated = 0u;
uint blended = 0u;

// The weight. Branch-free: a stopped pixel and a skipped splat both give 0. `depth` is the splat's where dy is 0.
float blend(inout Pixel pixel, Splat s, float along, float depth, float dy, uint place) {
    const float alpha = min(unclamped_alpha(exponent(conic_roots(along, s.q, s.r, dy)), s.opacity), ALPHA_MAX);
    const float next = attenuate(pixel.transmittance, alpha);
    const bool goes_on = next >= TRANSMITTANCE_MIN;
    const float weight = mix(0.0, alpha * pixel.transmittance, goes_on);
    pixel.colour += weight * s.colour;
    if (AUX != 0u) pixel.aux += weight * vec4(depth + s.slope.y * dy, s.normal);
    pixel.last = mix(pixel.last, place, weight > 0.0);
    if (COUNT != 0u) {
        evaluated += uint(all(greaterThan(vec2(pixel.transmittance, s.opacity), vec2(0.0))));
        blended += uint(weight > 0.0);
    }
    pixel.transmittance = mix(-abs(pixel.transmittance), next, goes_on);
    return weight;
}

// Weights are positive, so their bits order like the weights. Reading first avoids most atomics, because most weights
// are not the largest.
void keep_weight(uint splat, float weight) {
    const uint bits = floatBitsToUint(weight);
    if (bits > weights[splat]) atomicMax(weights[splat], bits);
}

void store(Pixel pixel, uvec2 at) {
    const uint k = at.y * push.width + at.x;
    const float transmittance = abs(pixel.transmittance);
    image[k] = vec4(pixel.colour + transmittance * vec3(push.red, push.green, push.blue), transmittance);
    if (AUX != 0u) aux_image[k] = pixel.aux;
    last_places[k] = pixel.last;
}

Pixel fresh(uvec2 at) {
    const bool inside = at.x < push.width && at.y < push.height;
    return Pixel(inside ? 1.0 : -1.0, vec3(0.0), vec4(0.0), 0u);
}

#ifdef COLUMN

// Splats per round of the loop: at every turn of a loop a software rasterizer merges all loop variables under the mask
// of active lanes. Eight splats are no faster than four, and waste seven when a tile's last batch has one.
#ifdef SUBGROUP_EMULATED
// Some compilers take time quadratic in a shader's length.
const uint UNROLL = 1u;
#else
const uint UNROLL = 4u;
#endif

void main() {
    const uint tile = group_index();
    const uvec2 range = tile < tile_total(SIDE) ? tile_ranges[tile] : uvec2(0u);
    const uint lane = subgroup_lane();
    const uvec2 top = tile_corner(tile, SIDE) + uvec2(lane, 0u);
    const vec2 center = vec2(top) + 0.5;

    Pixel pixels[SIDE];
    [[unroll]] for (uint j = 0u; j < SIDE; ++j) pixels[j] = fresh(top + uvec2(0u, j));

    // Both loops test at their end, see common.glsl.
    if (range.x < range.y) {
        uint base = range.x;
        float most;
        do {
            const uint n = min(BATCH, range.y - base);
            Splat mine = load_splat(sorted_splats[base + min(lane, n - 1u)]);
            mine.opacity = lane < n ? mine.opacity : 0.0;
            hand_out(mine);
            uint k0 = 0u;
            do {
                [[unroll]] for (uint u = 0u; u < UNROLL; ++u) {
                    const uint k = k0 + u;
                    const Splat s = shuffled(mine, k);
                    const float dx = center.x - s.x;
                    precise float along = s.p * dx;
                    const float depth = s.depth + s.slope.x * dx;
                    precise float dy0 = center.y - s.y;
                    float weight = 0.0;
                    [[unroll]] for (uint j = 0u; j < SIDE; ++j) {
                        precise float dy = dy0 + float(j);
                        weight = max(weight, blend(pixels[j], s, along, depth, dy, base - range.x + k + 1u));
                    }
                    if (WEIGHTS != 0u) {
                        if (weight > 0.0) keep_weight(sorted_splats[base + k], weight);
                    }
                }
                k0 += UNROLL;
            } while (k0 < n);
            most = -1.0;
            [[unroll]] for (uint j = 0u; j < SIDE; ++j) most = max(most, pixels[j].transmittance);
            base += BATCH;
        } while (base < range.y && subgroup_any(most > 0.0));
    }

    [[unroll]] for (uint j = 0u; j < SIDE; ++j) {
        const uvec2 at = top + uvec2(0u, j);
        if (tile < tile_total(SIDE) && at.x < push.width && at.y < push.height) store(pixels[j], at);
    }
    if (COUNT != 0u) {
        atomicAdd(pair_counts[FORWARD_EVALUATED], evaluated);
        atomicAdd(pair_counts[FORWARD_BLENDED], blended);
    }
}

#else

#include "staged.glsl"
shared uint going_on;

void blend_splat(inout Pixel pixel, Splat s, vec2 center, uint place, uint list) {
    const float dx = center.x - s.x;
    precise float along = s.p * dx;
    const float weight = blend(pixel, s, along, s.depth + s.slope.x * dx, center.y - s.y, place);
    if (WEIGHTS != 0u) {
        if (weight > 0.0) keep_weight(sorted_splats[list + place - 1u], weight);
    }
}

void main() {
    const uint tile = group_index();
    const uvec2 range = tile < tile_total(SIDE) ? tile_ranges[tile] : uvec2(0u);
    const uvec2 corner = tile_corner(tile, SIDE);
    const uint rank = pixel_rank();
    const uvec2 at = corner + pixel_place(rank);
    const vec2 center = vec2(at) + 0.5;
    Pixel pixel = fresh(at);

    for (uint base = range.x; base < range.y; base += BATCH) {
        if (local_index() == 0u) going_on = 0u;
        clear_blocks();
        barrier();
        if (pixel.transmittance > 0.0) atomicOr(going_on, 1u);
        const uint n = min(BATCH, range.y - base);
        if (local_index() < n) stage(local_index(), load_splat(sorted_splats[base + local_index()]));
        if (BLOCK != 0u && local_index() % BATCH < n) {
            const uint splat = sorted_splats[base + local_index() % BATCH];
            touch_blocks(LOAD4(splat2d, 3u * splat), LOAD4(splat2d, 3u * splat + 1u), corner);
        }
        barrier();
        if (going_on == 0u) break;
        const uint first = base - range.x + 1u;
        if (BLOCK == 0u) {
            for (uint k = 0u; k < n; ++k) {
                if (pixel.transmittance <= 0.0) break;
                blend_splat(pixel, staged(k), center, first + k, range.x);
            }
        } else {
            for (uint k0 = 0u; k0 < n; k0 += 32u) {
                // From the lowest bit to the highest: front to back.
                for (uint bits = touched_word(rank, k0 / 32u); bits > 0u; bits -= bits & (~bits + 1u)) {
                    if (pixel.transmittance <= 0.0) break;
                    const uint k = k0 + uint(findLSB(bits));
                    blend_splat(pixel, staged(k), center, first + k, range.x);
                }
            }
        }
        barrier();
    }

    if (tile < tile_total(SIDE) && at.x < push.width && at.y < push.height) store(pixel, at);
    if (COUNT != 0u) {
        atomicAdd(pair_counts[FORWARD_EVALUATED], evaluated);
        atomicAdd(pair_counts[FORWARD_BLENDED], blended);
    }
}

#endif
