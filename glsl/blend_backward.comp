#version 460
// blend_backward: gradients of splat2d (and of the normals) from those of image and aux, walking every tile's list back
// to front. column: one thread owns a column of 8 pixels, one workgroup (8 threads) a tile of 8x8. pixel: one thread
// owns two pixels, one workgroup (128 threads) a chunk of the list of a tile of 16x16; with BLOCK, subgroups leave out
// splats that do not show in the pixels they own. slots: a row of partial sums per (splat, tile) pair, written once and
// summed in a fixed order; slot_sum adds the rows. In pixel each subgroup sums its pixels independently, and after every
// few splats the workgroup adds the sums of the subgroups. atomic, cas: sums are added to the splat's row by native float
// atomics, or by compare-and-swap.
//! variant column_slots COLUMN SLOTS
//! variant column_atomic COLUMN ATOMIC
//! variant column_cas COLUMN CAS
//! variant column_emulated_slots COLUMN SLOTS SUBGROUP_EMULATED
//! variant pixel_slots PIXEL SLOTS WITH_SUBGROUPS
//! variant pixel_atomic PIXEL ATOMIC WITH_SUBGROUPS
//! variant pixel_cas PIXEL CAS WITH_SUBGROUPS
//! variant pixel_emulated_slots PIXEL SLOTS WITH_SUBGROUPS SUBGROUP_EMULATED
//! variant pixel_emulated_cas PIXEL CAS WITH_SUBGROUPS SUBGROUP_EMULATED
//! texels(COLUMN)
#extension GL_GOOGLE_include_directive : require
#ifdef ATOMIC
#extension GL_EXT_shader_atomic_float : require
#endif
#ifdef COLUMN
#include "blend_column.glsl"
#else
#define THREAD_PIXELS 2
#include "blend_pixel.glsl"
#ifndef SUBGROUP_EMULATED
// Subgroups process a batch, or a part of a batch, independently.
#define APART
#endif
#endif
#include "blend_backward.glsl"
#ifdef PIXEL
#include "kept.glsl"
#endif

// Sums over the pixels of one thread: of v = dL/d(exponent, base e) times 1, dy, dy^2, and the blended channels.
struct Sums {
    vec3 v;
    vec3 colour;
    vec4 aux;
    vec2 abs_mean;
    // Whether any pixel blended the splat. Sums of several pixels can cancel.
    bool hit;
};

const Sums NO_SUMS = Sums(vec3(0.0), vec3(0.0), vec4(0.0), vec2(0.0), false);

// `depth` is the splat's where dy is 0.
void blend_back(inout Pixel pixel, inout Sums sums, Splat s, float along, float depth, float dy, uint place) {
    const bool reached = place <= pixel.last;
    const vec2 roots = conic_roots(along, s.q, s.r, dy);
    const Share share = step_back(pixel.transmittance, pixel.behind, pixel.grad, pixel.grad_aux, s, exponent(roots),
                                  depth + s.slope.y * dy, reached);
    const float v_dy = share.v * dy;
    sums.v += vec3(share.v, v_dy, v_dy * dy);
    sums.colour += share.weight * pixel.grad;
    sums.hit = sums.hit || share.weight > 0.0;
    if (AUX != 0u) sums.aux += share.weight * pixel.grad_aux;
    if (ABS != 0u) sums.abs_mean += abs(share.v * vec2(s.p * roots.x, s.q * roots.x + s.r * roots.y));
    if (COUNT != 0u) {
        evaluated += reached ? 1u : 0u;
        blended += share.weight > 0.0 ? 1u : 0u;
    }
}

// The columns 0 to 4 (mean, conic) from the sums: exponent = -(A dx^2 + C dy^2) / 2 - B dx dy with d = pixel - mean,
// and in base 2 -(p dx + q dy)^2 - (r dy)^2.
void columns(Sums sums, Splat s, float dx, float along, out float mean_x, out float mean_y, out vec3 conic) {
    const float root = along * sums.v.x + s.q * sums.v.y;
    mean_x = TWO_LN_2 * s.p * root;
    mean_y = TWO_LN_2 * (s.q * root + s.r * s.r * sums.v.y);
    conic = vec3(-0.5 * dx * dx * sums.v.x, -dx * sums.v.y, -0.5 * sums.v.z);
}

#ifdef COLUMN

// One step of a transposing butterfly: adds lanes that differ in `bit`. Lanes without the bit keep x, lanes with the
// bit keep y.
float fold(float x, float y, uint lane, uint bit) {
    const bool upper = (lane & bit) != 0u;
    return (upper ? y : x) + subgroup_shuffle(upper ? x : y, lane ^ bit);
}

// Lane k gets the sum of column k over the 8 lanes, in a fixed order.
float fold8(vec4 low, vec4 high, uint lane) {
    const float a = fold(fold(low.x, low.y, lane, 1u), fold(low.z, low.w, lane, 1u), lane, 2u);
    const float b = fold(fold(high.x, high.y, lane, 1u), fold(high.z, high.w, lane, 1u), lane, 2u);
    return fold(a, b, lane, 4u);
}

void main() {
    const uint tile = group_index();
    const bool real = tile < tile_total(SIDE);
    const uvec2 range = real ? tile_ranges[tile] : uvec2(0u);
    const uint lane = subgroup_lane();
    const uvec2 corner = tile_corner(tile, SIDE) + uvec2(lane, 0u);
    const vec2 center = vec2(corner) + 0.5;

    Pixel pixels[SIDE];
    uint mine_last = 0u;
    [[unroll]] for (uint j = 0u; j < SIDE; ++j) {
        const uvec2 at = corner + uvec2(0u, j);
        pixels[j] = load_pixel(at, real && at.x < push.width && at.y < push.height);
        mine_last = max(mine_last, pixels[j].last);
    }
    const uint top = min(subgroup_max(mine_last), range.y - range.x);

#ifdef SLOTS
    for (uint i = range.x + top; i < range.y; ++i) {
        const uint row = sorted_slots[i];
        store_grad(row, lane, 0.0);
        if (lane < (AUX != 0u ? 7u : 4u)) store_grad(row, 8u + lane, 0.0);
    }
#endif

    // Both loops test at their end, see common.glsl.
    if (top > 0u) {
        uint left = top;
        do {
            const uint n = min(left, BATCH);
            const uint pair = range.x + left - 1u - min(lane, n - 1u);
            Splat mine = load_splat(sorted_splats[pair]);
            mine.opacity = lane < n ? mine.opacity : 0.0;
            const float mine_inverse = mine.opacity > 0.0 ? 1.0 / mine.opacity : 0.0;
#ifdef SLOTS
            const uint mine_row = prefetch_row(row_of(pair));
#else
            const uint mine_row = row_of(pair);
#endif
            hand_out(mine);
            uint k = 0u;
            do {
                const Splat s = shuffled(mine, k);
                const uint place = left - k;
                const float dx = center.x - s.x;
                precise float along = s.p * dx;
                const float depth = s.depth + s.slope.x * dx;
                precise float dy0 = center.y - s.y;
                Sums sums = NO_SUMS;
                [[unroll]] for (uint j = 0u; j < SIDE; ++j) {
                    precise float dy = dy0 + float(j);
                    blend_back(pixels[j], sums, s, along, depth, dy, place);
                }
                float mean_x, mean_y;
                vec3 conic;
                columns(sums, s, dx, along, mean_x, mean_y, conic);
                const float opacity = sums.v.x * subgroup_shuffle(mine_inverse, k);
                const float first = fold8(vec4(mean_x, mean_y, conic.xy), vec4(conic.z, opacity, sums.colour.rg), lane);
                const vec2 abs_mean = TWO_LN_2 * sums.abs_mean;
                float second;
                if (AUX != 0u) {
                    second = fold8(vec4(sums.colour.b, sums.aux.x, abs_mean), vec4(sums.aux.yzw, 0.0), lane);
                } else {
                    second = fold(sums.colour.b, 0.0, lane, 1u);
                    second = fold(second, ABS != 0u ? fold(abs_mean.x, abs_mean.y, lane, 1u) : 0.0, lane, 2u);
                    second += subgroup_shuffle(second, lane ^ 4u);
                }
                const uint row = subgroup_shuffle(mine_row, k);
                store_grad(row, lane, first);
                if (lane < (AUX != 0u ? 7u : 4u)) store_grad(row, 8u + lane, second);
                ++k;
            } while (k < n);
            left -= n;
        } while (left > 0u);
    }
    if (COUNT != 0u) {
        atomicAdd(pair_counts[BACKWARD_EVALUATED], evaluated);
        atomicAdd(pair_counts[BACKWARD_BLENDED], blended);
    }
}

#else

#include "staged.glsl"
shared float staged_inverse[BATCH];
shared uint staged_row[BATCH];
shared uint most;
// Columns of a row with sums; without AUX the ninth of 12 is 0.
const uint COLUMNS = AUX != 0u ? 15u : ABS != 0u ? 12u : 9u;

#ifdef SLOTS
// Sums of subgroups for the splats of a part: row (subgroup, splat) of 16 columns; and per subgroup, a bit for each
// splat with sums.
shared float subgroup_sums[16u * LOCAL_SIZE];
shared uint subgroup_has[LOCAL_SIZE];

// Splats of a part: the number of rows per subgroup.
uint part_splats() { return min(32u, subgroup_width()); }

void accumulate(uint place, uint column, float sum) { subgroup_sums[16u * (subgroup_number() * part_splats() + place) + column] = sum; }
#else
uint part_splats() { return 32u; }

void accumulate(uint row, uint column, float sum) { store_grad(row, column, sum); }
#endif

// Adds each column over the subgroup by a transposing butterfly. A step adds lanes that differ in one bit; lanes
// without the bit keep the even columns, lanes with the bit keep the odd columns. A column takes about one shuffle
// instead of log2(width) shuffles.
float butterfly(float x, float y, uint bit) {
    const bool upper = (subgroup_lane() & bit) != 0u;
    return (upper ? y : x) + subgroup_shuffle_xor(upper ? x : y, bit);
}

// The sums over 8 lanes: lane k gets columns k % 8 and k % 8 + 8.
vec2 add_eight(float column[16]) {
    // Columns 9 and 12 to 14 belong to AUX; without AUX columns 8 to 11 need two steps.
    float pairs[8];
    [[unroll]] for (uint c = 0u; c < 8u; ++c) {
        const bool used = AUX != 0u || c < 5u || c == 5u && ABS != 0u;
        pairs[c] = used ? butterfly(column[2u * c], column[2u * c + 1u], 1u) : 0.0;
    }
    const float first = butterfly(butterfly(pairs[0], pairs[1], 2u), butterfly(pairs[2], pairs[3], 2u), 4u);
    const float last = AUX != 0u ? butterfly(pairs[6], pairs[7], 2u) : 0.0;
    return vec2(first, butterfly(butterfly(pairs[4], pairs[5], 2u), last, 4u));
}

// Adds the columns of one splat. Narrow subgroups sum column by column.
void add_up(uint row, float column[16]) {
    const uint lane = subgroup_lane();
    if (subgroup_width() < 8u) {
        [[unroll]] for (uint c = 0u; c < 15u; ++c) {
            if (c < COLUMNS) {
                const float sum = subgroup_add(column[c]);
                if (subgroup_elect()) accumulate(row, c, sum);
            }
        }
    } else {
        const vec2 sums = add_eight(column);
        if (subgroup_width() < 16u) {
            accumulate(row, lane, sums.x);
            if (8u + lane < COLUMNS) accumulate(row, 8u + lane, sums.y);
        } else {
            const float sum = butterfly(sums.x, sums.y, 8u);
            if (lane < COLUMNS) accumulate(row, lane, sum);
        }
    }
}

// Adds the columns of one or two splats, with one last step and one access to memory for both: every 16 lanes have all
// columns of a splat, the lanes with bit 16 those of the second. Called by all threads of a subgroup with the same rows
// (slots: indices in the part).
void add_up_two(uint splats, uint rows[2], float columns[2][16]) {
    if (subgroup_width() < 32u) {
        add_up(rows[0], columns[0]);
        if (splats > 1u) add_up(rows[1], columns[1]);
    } else {
        const uint lane = subgroup_lane();
        const vec2 one = add_eight(columns[0]);
        const vec2 two = add_eight(columns[1]);
        float sum = butterfly(butterfly(one.x, one.y, 8u), butterfly(two.x, two.y, 8u), 16u);
        [[unroll]] for (uint k = 5u; k < 7u; ++k) {
            if (1u << k < subgroup_width()) sum += subgroup_shuffle_xor(sum, 1u << k);
        }
        if (lane < 16u * splats && lane % 16u < COLUMNS) accumulate(rows[lane / 16u], lane % 16u, sum);
    }
}

// Moves a thread's pixels past staged splat k, which is the `place`-th of the tile's list: the splat's columns, and
// whether they have anything. `shows`: whether the splat touches the pixel's block.
bool take(inout Pixel pixels[2], bool shows[2], uint k, uint place, vec2 center, out float column[16]) {
    const Splat s = staged(k);
    const float dx = center.x - s.x;
    precise float along = s.p * dx;
    const float depth = s.depth + s.slope.x * dx;
    Sums sums = NO_SUMS;
    [[unroll]] for (uint j = 0u; j < 2u; ++j) {
        if (shows[j]) {
            // As where a thread owns one pixel: centre minus mean, rounded once.
            precise float dy = (center.y + float(j * BLOCK_H)) - s.y;
            blend_back(pixels[j], sums, s, along, depth, dy, place);
        }
    }
    float mean_x, mean_y;
    vec3 conic;
    columns(sums, s, dx, along, mean_x, mean_y, conic);
    const vec2 abs_mean = TWO_LN_2 * sums.abs_mean;
    column = float[16](mean_x, mean_y, conic.x, conic.y, conic.z, sums.v.x * staged_inverse[k],
        sums.colour.r, sums.colour.g, sums.colour.b, sums.aux.x, abs_mean.x, abs_mean.y,
        sums.aux.y, sums.aux.z, sums.aux.w, 0.0);
    return sums.hit;
}

// Bits of the staged splats 32 word to 32 word + 31 that touch the upper and the lower block of this thread's pixels.
// With APART equal in all lanes of the subgroup, which may have several blocks.
uvec2 shown_in(uint upper, uint word) {
    uvec2 bits = uvec2(~0u);
#ifdef APART
    if (BLOCK != 0u) {
        bits = uvec2(0u);
        const uint first = upper - subgroup_lane() / BLOCK_PIXELS * 2u;
        for (uint b = 0u; b < max(subgroup_width() / BLOCK_PIXELS, 1u); ++b) {
            bits.x |= touched[(first + 2u * b) * TOUCH_WORDS + word];
            bits.y |= touched[(first + 2u * b + 1u) * TOUCH_WORDS + word];
        }
    }
#endif
    return bits;
}

#ifdef SLOTS
// Adds the subgroups' sums for the staged splats from k0 on, in the order of the subgroups, and stores the results.
void add_subgroups(uint k0, uint count) {
    const uint column = local_index() % 16u;
    const uint subgroups = LOCAL_SIZE / subgroup_width();
    for (uint j = local_index() / 16u; j < count; j += LOCAL_SIZE / 16u) {
        float sum = 0.0;
        for (uint s = 0u; s < subgroups; ++s) {
            if ((subgroup_has[s] >> j & 1u) != 0u) sum += subgroup_sums[16u * (s * part_splats() + j) + column];
        }
        if (column < (AUX != 0u ? 15u : 12u)) store_grad(staged_row[k0 + j], column, column < COLUMNS ? sum : 0.0);
    }
}
#endif

// A pixel that goes on behind the chunk begins with its state there.
void begin_chunk(inout Pixel pixel, uint at) {
    const vec4 state = states[at];
    float behind = dot(state.rgb, pixel.grad) + pixel.transmittance * pixel.behind;
    if (AUX != 0u) behind += dot(states[at + 1u], pixel.grad_aux);
    pixel.behind = behind / state.w;
    pixel.transmittance = state.w;
}

void main() {
    const uint tile = group_index() / CHUNKS;
    const uint part = group_index() % CHUNKS;
    const bool real = tile < tile_total(SIDE);
    const uvec2 range = real ? tile_ranges[tile] : uvec2(0u);
    const uint total = range.y - range.x;
    // The chunk: empty behind the end of the list.
    const uint low = min(part * chunk_splats(total), total);
    const uint chunk_end = min(low + chunk_splats(total), total);
    const uint t = local_index();
    const uvec2 corner = tile_corner(tile, SIDE);
    const uint rank = workgroup_rank();
    const uint upper = rank / BLOCK_PIXELS * 2u;
    const uvec2 places[2] = uvec2[2](pixel_place(upper, rank % BLOCK_PIXELS), pixel_place(upper + 1u, rank % BLOCK_PIXELS));
    const vec2 center = vec2(corner + places[0]) + 0.5;

    Pixel pixels[2];
    [[unroll]] for (uint j = 0u; j < 2u; ++j) {
        const uvec2 at = corner + places[j];
        pixels[j] = load_pixel(at, low < chunk_end && at.x < push.width && at.y < push.height);
    }
    if (t == 0u) most = 0u;
    barrier();
    atomicMax(most, max(pixels[0].last, pixels[1].last));
    barrier();
    // Splats of the chunk that any pixel reaches end here.
    const uint high = max(min(most, chunk_end), low);

#ifdef SLOTS
    for (uint i = high; i < chunk_end; ++i) {
        if (t < (AUX != 0u ? 15u : 12u)) store_grad(sorted_slots[range.x + i], t, 0.0);
    }
#endif
    if (CHUNKS > 1u && high > low) {
        [[unroll]] for (uint j = 0u; j < 2u; ++j) {
            if (pixels[j].last > high) begin_chunk(pixels[j], state_at(tile, part, places[j]));
        }
    }
#ifdef APART
    const uint own_top = subgroup_max(max(pixels[0].last, pixels[1].last));
#else
    const uint own_top = high;
#endif

    // Batches of the forward pass, whose masks are by words.
    for (uint ahead = high - low; ahead > 0u; ahead -= (ahead - 1u) % BATCH + 1u) {
        const uint n = (ahead - 1u) % BATCH + 1u;
        const uint base = low + ahead - n;
        barrier();
        if (t < n) {
            const uint pair = range.x + base + t;
            const Splat s = load_splat(sorted_splats[pair]);
            stage(t, s);
            staged_inverse[t] = s.opacity > 0.0 ? 1.0 / s.opacity : 0.0;
            staged_row[t] = row_of(pair);
        }
#ifdef APART
        if (BLOCK != 0u && t < BLOCKS * TOUCH_WORDS && 32u * (t % TOUCH_WORDS) < n) {
            touched[t] = masks[mask_at(tile, range.x, base / 32u + t % TOUCH_WORDS, t / TOUCH_WORDS)];
        }
#endif
        barrier();
        // A subgroup skips splats after the last contributor of all its pixels.
        const uint own = min(own_top - min(own_top, base), n);
#ifdef SLOTS
        // Every subgroup reaches every part, because all subgroups add the sums.
        const uint walked = n;
#else
        const uint walked = own;
#endif
        for (uint left = (walked + part_splats() - 1u) / part_splats(); left > 0u; left -= 1u) {
            const uint k0 = (left - 1u) * part_splats();
            const uint count = min(part_splats(), n - k0);
            const uvec2 shown = shown_in(upper, k0 / 32u) >> k0 % 32u;
            const uint some = (shown.x | shown.y) & low_bits(count) & low_bits(own - min(own, k0));
#ifdef SLOTS
            uint has = 0u;
#endif
            // From the highest bit to the lowest: back to front.
            uint bits = some;
            for (uint turn = 0u; turn < (uint(bitCount(some)) + 1u) / 2u; ++turn) {
                float columns[2][16];
                uint rows[2];
                bool hits[2];
                uint taken = 0u;
                [[unroll]] for (uint u = 0u; u < 2u; ++u) {
                    const bool there = bits > 0u;
                    const uint j = there ? uint(findMSB(bits)) : 0u;
                    const uint bit = there ? 1u << j : 0u;
                    bits &= ~bit;
                    const bool shows[2] = bool[2]((shown.x & bit) != 0u, (shown.y & bit) != 0u);
                    hits[u] = take(pixels, shows, k0 + j, base + k0 + j + 1u, center, columns[u]);
                    taken |= bit;
#ifdef SLOTS
                    rows[u] = j;
#else
                    rows[u] = staged_row[k0 + j];
#endif
                }
#ifdef APART
                if (!subgroup_any(hits[0] || hits[1])) continue;
#endif
                add_up_two(uint(bitCount(taken)), rows, columns);
#ifdef SLOTS
                has |= taken;
#endif
            }
#ifdef SLOTS
            if (subgroup_elect()) subgroup_has[subgroup_number()] = has;
            barrier();
            add_subgroups(k0, count);
            barrier();
#endif
        }
    }
    if (COUNT != 0u) {
        atomicAdd(pair_counts[BACKWARD_EVALUATED], evaluated);
        atomicAdd(pair_counts[BACKWARD_BLENDED], blended);
    }
}

#endif
