#version 460
// blend_forward: alpha-blends every tile's splats front to back into image, aux and last. column: one thread owns a
// column of 8 pixels, one workgroup (8 threads) a tile of 8x8. pixel: one thread owns a pixel, one workgroup (256
// threads) a tile of 16x16; with BLOCK, splats that do not show in a block of pixels are left out there. For the backward
// pass, pixel keeps with MASKS which splats show where, and with CHUNKS the state at the end of each chunk of a list.
//! variant column COLUMN
//! variant column_emulated COLUMN SUBGROUP_EMULATED
//! variant pixel PIXEL
//! texels(COLUMN)
#extension GL_GOOGLE_include_directive : require
#ifdef COLUMN
#include "blend_column.glsl"
#else
#define THREAD_PIXELS 1
#include "blend_pixel.glsl"
#include "tile.glsl"
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
#ifdef PIXEL
layout(constant_id = 6) const uint MASKS = 0u;  // 1: keep the bits of blocks.glsl
#define FORWARD
#include "kept.glsl"
#endif

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

// A splat's alpha at a pixel, and the auxiliary values there. `depth` is the splat's where dy is 0.
struct Shade {
    float alpha;
    vec4 aux;
};

Shade shade(Splat s, float along, float depth, float dy) {
    const float alpha = min(unclamped_alpha(exponent(conic_roots(along, s.q, s.r, dy)), s.opacity), ALPHA_MAX);
    return Shade(alpha, AUX != 0u ? vec4(depth + s.slope.y * dy, s.normal) : vec4(0.0));
}

// The weight. Branch-free: a stopped pixel and a skipped splat both give 0. `counts`: 0 for a splat that is not there.
float blend(inout Pixel pixel, Shade at, vec3 colour, bool counts, uint place) {
    const float next = attenuate(pixel.transmittance, at.alpha);
    const bool goes_on = next >= TRANSMITTANCE_MIN;
    const float weight = mix(0.0, at.alpha * pixel.transmittance, goes_on);
    pixel.colour += weight * colour;
    if (AUX != 0u) pixel.aux += weight * at.aux;
    pixel.last = mix(pixel.last, place, weight > 0.0);
    if (COUNT != 0u) {
        evaluated += uint(counts && pixel.transmittance > 0.0);
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
                        const Shade at = shade(s, along, depth, dy);
                        weight = max(weight, blend(pixels[j], at, s.colour, s.opacity > 0.0, base - range.x + k + 1u));
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
// Threads that share a staged splat's rows of blocks.
const uint TESTERS = LOCAL_SIZE / BATCH;

// Marks the blocks that the staged splat `local_index() % BATCH` touches, in this thread's rows of blocks. `p`, `q`:
// the first eight floats of its row of splat2d.
void touch_blocks(vec4 p, vec4 q, uvec2 corner) {
    const uint staged = local_index() % BATCH;
    const TileGrid grid = TileGrid(uvec2(push.width, push.height), uvec2(BLOCK_W, BLOCK_H));
    const TileEllipse e = tile_ellipse(p.xy, vec3(p.zw, q.x), q.y, grid);
    const uvec2 first = corner / uvec2(BLOCK_W, BLOCK_H);
    for (uint y = local_index() / BATCH; y < BLOCK_ROWS; y += TESTERS) {
        if (first.y + y < e.row_begin || first.y + y >= e.row_end) continue;
        const uvec2 columns = tile_row(e, first.y + y, grid);
        for (uint x = 0u; x < BLOCK_COLUMNS; ++x) {
            if (first.x + x >= columns.x && first.x + x < columns.y) {
                atomicOr(touched[(x * BLOCK_ROWS + y) * TOUCH_WORDS + staged / 32u], 1u << staged % 32u);
            }
        }
    }
}

// Keeps a pixel's state at the end of a chunk, with what the chunk alone added.
void keep_state(inout Pixel pixel, uint at) {
    states[at] = vec4(pixel.colour, abs(pixel.transmittance));
    if (AUX != 0u) states[at + 1u] = pixel.aux;
    pixel.colour = vec3(0.0);
    pixel.aux = vec4(0.0);
}

// Turns what each of the ended chunks added into what lies behind each, and adds up the pixel.
void sum_states(inout Pixel pixel, uint tile, uint ended, uvec2 place) {
    for (uint chunk = ended; chunk > 0u; chunk -= 1u) {
        const uint at = state_at(tile, chunk - 1u, place);
        const vec4 own = states[at];
        states[at] = vec4(pixel.colour, own.w);
        pixel.colour += own.rgb;
        if (AUX != 0u) {
            const vec4 own_aux = states[at + 1u];
            states[at + 1u] = pixel.aux;
            pixel.aux += own_aux;
        }
    }
}

// Splats whose alphas are worked out together: they do not wait for one another, only the blending does.
const uint AHEAD = 4u;

// Blends the lowest AHEAD of the staged splats k0 + (bits of `bits`), front to back, and clears their bits. `first` is
// the place of staged splat 0 in the tile's list, which begins at `list`.
void blend_next(inout Pixel pixel, inout uint bits, uint k0, vec2 center, uint first, uint list) {
    Shade shades[AHEAD];
    vec3 colours[AHEAD];
    uint places[AHEAD];
    bool counts[AHEAD];
    [[unroll]] for (uint u = 0u; u < AHEAD; ++u) {
        const bool there = bits > 0u;
        const uint k = k0 + (there ? uint(findLSB(bits)) : 0u);
        bits &= bits - 1u;
        const Splat s = staged(k);
        const float dx = center.x - s.x;
        precise float along = s.p * dx;
        shades[u] = shade(s, along, s.depth + s.slope.x * dx, center.y - s.y);
        shades[u].alpha = there ? shades[u].alpha : 0.0;
        colours[u] = s.colour;
        places[u] = first + k;
        counts[u] = there && s.opacity > 0.0;
    }
    [[unroll]] for (uint u = 0u; u < AHEAD; ++u) {
        const float weight = blend(pixel, shades[u], colours[u], counts[u], places[u]);
        if (WEIGHTS != 0u) {
            if (weight > 0.0) keep_weight(sorted_splats[list + places[u] - 1u], weight);
        }
    }
}

void main() {
    const uint tile = group_index();
    const uvec2 range = tile < tile_total(SIDE) ? tile_ranges[tile] : uvec2(0u);
    const uvec2 corner = tile_corner(tile, SIDE);
    const uint t = local_index();
    const uint block = t / BLOCK_PIXELS;
    const uvec2 place = pixel_place(block, t % BLOCK_PIXELS);
    const uvec2 at = corner + place;
    const vec2 center = vec2(at) + 0.5;
    const uint count = range.y - range.x;
    const uint chunk = chunk_splats(count);
    uint ended = 0u;
    Pixel pixel = fresh(at);

    for (uint base = range.x; base < range.y; base += BATCH) {
        if (t == 0u) going_on = 0u;
        if (BLOCK != 0u && t < BLOCKS * TOUCH_WORDS) touched[t] = 0u;
        barrier();
        if (pixel.transmittance > 0.0) atomicOr(going_on, 1u);
        const uint n = min(BATCH, range.y - base);
        if (t < n) stage(t, load_splat(sorted_splats[base + t]));
        if (BLOCK != 0u && t % BATCH < n) {
            const uint splat = sorted_splats[base + t % BATCH];
            touch_blocks(LOAD4(splat2d, 3u * splat), LOAD4(splat2d, 3u * splat + 1u), corner);
        }
        barrier();
        if (going_on == 0u) break;
        const uint done = base - range.x;
        if (BLOCK != 0u && MASKS != 0u && t < BLOCKS * TOUCH_WORDS) {
            const uint word = t % TOUCH_WORDS;
            if (32u * word < n) masks[mask_at(tile, range.x, done / 32u + word, t / TOUCH_WORDS)] = touched[t];
        }
        for (uint k0 = 0u; k0 < n; k0 += 32u) {
            uint bits = BLOCK == 0u ? low_bits(n - k0) : touched[block * TOUCH_WORDS + k0 / 32u];
            const uint turns = (uint(bitCount(bits)) + AHEAD - 1u) / AHEAD;
            for (uint turn = 0u; turn < turns && pixel.transmittance > 0.0; ++turn) {
                blend_next(pixel, bits, k0, center, done + 1u, range.x);
            }
        }
        if (CHUNKS > 1u && (done + n) % chunk == 0u && done + n < count) {
            keep_state(pixel, state_at(tile, ended, place));
            ++ended;
        }
        barrier();
    }

    if (CHUNKS > 1u) sum_states(pixel, tile, ended, place);
    if (tile < tile_total(SIDE) && at.x < push.width && at.y < push.height) store(pixel, at);
    if (COUNT != 0u) {
        atomicAdd(pair_counts[FORWARD_EVALUATED], evaluated);
        atomicAdd(pair_counts[FORWARD_BLENDED], blended);
    }
}

#endif
