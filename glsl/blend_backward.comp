#version 460
// blend_backward: gradients of splat2d (and of the normals) from those of image and aux, walking every tile's list back
// to front. column: one thread owns a column of 8 pixels, one workgroup (8 threads) a tile of 8x8. pixel: one thread
// owns a pixel, one workgroup (256 threads) a tile of 16x16; with BLOCK, subgroups leave out splats that do not show in
// the pixels they own. slots: a row of partial sums per (splat, tile) pair, written once and summed in a fixed order;
// slot_sum adds the rows. apart: each subgroup sums its pixels independently, and after every few splats the workgroup
// adds the sums of the subgroups. atomic, cas: sums are added to the splat's row by native float atomics, or by
// compare-and-swap.
//! variant column_slots COLUMN SLOTS
//! variant column_atomic COLUMN ATOMIC
//! variant column_cas COLUMN CAS
//! variant column_emulated_slots COLUMN SLOTS SUBGROUP_EMULATED
//! variant pixel_slots PIXEL SLOTS
//! variant pixel_apart_slots PIXEL SLOTS WITH_SUBGROUPS
//! variant pixel_atomic PIXEL ATOMIC WITH_SUBGROUPS
//! variant pixel_cas PIXEL CAS WITH_SUBGROUPS
//! variant pixel_emulated_cas PIXEL CAS WITH_SUBGROUPS SUBGROUP_EMULATED
//! texels(COLUMN)
#extension GL_GOOGLE_include_directive : require
#ifdef ATOMIC
#extension GL_EXT_shader_atomic_float : require
#endif
#ifdef COLUMN
#include "blend_column.glsl"
#else
#include "blend_pixel.glsl"
#if defined(WITH_SUBGROUPS) && !defined(SUBGROUP_EMULATED)
// Subgroups process a batch, or a part of a batch, independently.
#define APART
#include "blocks.glsl"
#endif
#endif
#include "blend_backward.glsl"

// Sums over the pixels of one thread: of v = dL/d(exponent, base e) times 1, dy, dy^2, and the blended channels.
struct Sums {
    vec3 v;
    vec3 colour;
    vec4 aux;
    vec2 abs_mean;
};

// `depth` is the splat's where dy is 0.
void blend_back(inout Pixel pixel, inout Sums sums, Splat s, float along, float depth, float dy, uint place) {
    const bool reached = place <= pixel.last;
    const vec2 roots = conic_roots(along, s.q, s.r, dy);
    const Share share = step_back(pixel.transmittance, pixel.behind, pixel.grad, pixel.grad_aux, s, exponent(roots),
                                  depth + s.slope.y * dy, reached);
    const float v_dy = share.v * dy;
    sums.v += vec3(share.v, v_dy, v_dy * dy);
    sums.colour += share.weight * pixel.grad;
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
                Sums sums = Sums(vec3(0.0), vec3(0.0), vec4(0.0), vec2(0.0));
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

#if defined(SLOTS) && !defined(APART)
shared float parts[16u * LOCAL_SIZE];
shared float part_sums[LOCAL_SIZE];

// Adds 16 columns over the workgroup in a fixed order and stores them. Called by all threads with the same row.
void add_up(uint row, float column[16]) {
    const uint t = local_index();
    [[unroll]] for (uint c = 0u; c < 16u; ++c) parts[c * LOCAL_SIZE + t] = column[c];
    barrier();
    const uint first = t / 16u * LOCAL_SIZE + t % 16u;
    float sum = 0.0;
    for (uint i = 0u; i < 16u; ++i) sum += parts[first + 16u * i];
    part_sums[t] = sum;
    barrier();
    if (t < (AUX != 0u ? 15u : 12u)) {
        sum = 0.0;
        for (uint i = 0u; i < 16u; ++i) sum += part_sums[16u * t + i];
        store_grad(row, t, sum);
    }
}
#else
#ifdef SLOTS
// Sums of subgroups for the splats of a part: row (subgroup, splat) of 16 columns; and per subgroup, a bit for each
// splat with sums.
shared float subgroup_sums[16u * LOCAL_SIZE];
shared uint subgroup_has[LOCAL_SIZE];

// Splats of a part: the number of rows per subgroup.
uint part_splats() { return min(32u, subgroup_width()); }

void accumulate(uint place, uint column, float sum) { subgroup_sums[16u * (subgroup_number() * part_splats() + place) + column] = sum; }
#else
void accumulate(uint row, uint column, float sum) { store_grad(row, column, sum); }
#endif

// Adds each column over the subgroup by a transposing butterfly. A step adds lanes that differ in one bit; lanes
// without the bit keep the even columns, lanes with the bit keep the odd columns. A column takes about one shuffle
// instead of log2(width) shuffles. At the end lane k has column k (with 8 lanes, also column k + 8) and passes it on.
// Narrower subgroups sum column by column.
float butterfly(float x, float y, uint bit) {
    const bool upper = (subgroup_lane() & bit) != 0u;
    return (upper ? y : x) + subgroup_shuffle_xor(upper ? x : y, bit);
}

// Called by all threads of a subgroup with the same row (slots: index in the part).
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
        // Columns 9 and 12 to 14 belong to AUX; without AUX columns 8 to 11 need two steps.
        float pairs[8];
        [[unroll]] for (uint c = 0u; c < 8u; ++c) {
            const bool used = AUX != 0u || c < 5u || c == 5u && ABS != 0u;
            pairs[c] = used ? butterfly(column[2u * c], column[2u * c + 1u], 1u) : 0.0;
        }
        const float first = butterfly(butterfly(pairs[0], pairs[1], 2u), butterfly(pairs[2], pairs[3], 2u), 4u);
        const float last = AUX != 0u ? butterfly(pairs[6], pairs[7], 2u) : 0.0;
        const float second = butterfly(butterfly(pairs[4], pairs[5], 2u), last, 4u);
        if (subgroup_width() < 16u) {
            accumulate(row, lane, first);
            if (8u + lane < COLUMNS) accumulate(row, 8u + lane, second);
        } else {
            float sum = butterfly(first, second, 8u);
            [[unroll]] for (uint k = 4u; k < 7u; ++k) {
                if (1u << k < subgroup_width()) sum += subgroup_shuffle_xor(sum, 1u << k);
            }
            if (lane < COLUMNS) accumulate(row, lane, sum);
        }
    }
}
#endif

// Moves a pixel past staged splat k and adds the splat's gradients to `row`; false when there are none. Called by all
// threads that add_up sums over.
bool blend_splat(inout Pixel pixel, uint k, uint row, vec2 center, uint place) {
    const Splat s = staged(k);
    const float dx = center.x - s.x;
    precise float along = s.p * dx;
    Sums sums = Sums(vec3(0.0), vec3(0.0), vec4(0.0), vec2(0.0));
    blend_back(pixel, sums, s, along, s.depth + s.slope.x * dx, center.y - s.y, place);
#ifdef APART
    if (!subgroup_any(sums.v.x != 0.0 || sums.colour != vec3(0.0) || sums.aux != vec4(0.0))) return false;
#endif
    float mean_x, mean_y;
    vec3 conic;
    columns(sums, s, dx, along, mean_x, mean_y, conic);
    const vec2 abs_mean = TWO_LN_2 * sums.abs_mean;
    add_up(row, float[16](mean_x, mean_y, conic.x, conic.y, conic.z, sums.v.x * staged_inverse[k],
        sums.colour.r, sums.colour.g, sums.colour.b, sums.aux.x, abs_mean.x, abs_mean.y,
        sums.aux.y, sums.aux.z, sums.aux.w, 0.0));
    return true;
}

#ifdef APART
// Bits of the staged splats 32 word to 32 word + 31 that touch a block of this subgroup. Equal in all lanes of the
// subgroup.
uint subgroup_touched(uint word) {
    const uint first = (pixel_rank() - subgroup_lane()) / BLOCK_PIXELS;
    uint bits = touched[first * TOUCH_WORDS + word];
    for (uint b = 1u; b < subgroup_width() / BLOCK_PIXELS; ++b) bits |= touched[(first + b) * TOUCH_WORDS + word];
    return bits;
}

uint low_bits(uint count) { return count < 32u ? (1u << count) - 1u : ~0u; }

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
#endif

void main() {
    const uint tile = group_index();
    const bool real = tile < tile_total(SIDE);
    const uvec2 range = real ? tile_ranges[tile] : uvec2(0u);
    const uint t = local_index();
    const uvec2 corner = tile_corner(tile, SIDE);
    const uvec2 at = corner + pixel_place(pixel_rank());
    const vec2 center = vec2(at) + 0.5;
    Pixel pixel = load_pixel(at, real && at.x < push.width && at.y < push.height);

    if (t == 0u) most = 0u;
    barrier();
    atomicMax(most, pixel.last);
    barrier();
    const uint top = min(most, range.y - range.x);
#ifdef APART
    const uint own_top = subgroup_max(pixel.last);
#endif

#ifdef SLOTS
    for (uint i = range.x + top; i < range.y; ++i) {
        if (t < (AUX != 0u ? 15u : 12u)) store_grad(sorted_slots[i], t, 0.0);
    }
#endif

    for (uint left = top; left > 0u; left -= min(left, BATCH)) {
        const uint n = min(left, BATCH);
        barrier();
#ifdef APART
        if (BLOCK != 0u) {
            clear_blocks();
            barrier();
        }
#endif
        if (t < n) {
            const uint pair = range.x + left - 1u - t;
            const Splat s = load_splat(sorted_splats[pair]);
            stage(t, s);
            staged_inverse[t] = s.opacity > 0.0 ? 1.0 / s.opacity : 0.0;
            staged_row[t] = row_of(pair);
        }
#ifdef APART
        if (BLOCK != 0u && t % BATCH < n) {
            const uint splat = sorted_splats[range.x + left - 1u - t % BATCH];
            touch_blocks(LOAD4(splat2d, 3u * splat), LOAD4(splat2d, 3u * splat + 1u), corner);
        }
        barrier();
        // A subgroup skips splats after the last contributor of all its pixels.
        const uint begin = min(left - min(left, own_top), n);
#ifdef SLOTS
        // Every subgroup reaches this point for every part, because all subgroups add the sums.
        const uint first = 0u;
        const uint step = part_splats();
#else
        const uint first = begin / 32u * 32u;
        const uint step = 32u;
#endif
        for (uint k0 = first; k0 < n; k0 += step) {
            const uint count = min(step, n - k0);
            const uint behind = low_bits(begin - min(begin, k0));
            const uint shown = BLOCK == 0u ? ~0u : subgroup_touched(k0 / 32u) >> k0 % 32u;
#ifdef SLOTS
            uint has = 0u;
#endif
            for (uint bits = shown & low_bits(count) & ~behind; bits > 0u; bits -= bits & (~bits + 1u)) {
                const uint j = uint(findLSB(bits));
#ifdef SLOTS
                if (blend_splat(pixel, k0 + j, j, center, left - k0 - j)) has |= 1u << j;
#else
                blend_splat(pixel, k0 + j, staged_row[k0 + j], center, left - k0 - j);
#endif
            }
#ifdef SLOTS
            if (subgroup_elect()) subgroup_has[subgroup_number()] = has;
            barrier();
            add_subgroups(k0, count);
            barrier();
#endif
        }
#else
        barrier();
        for (uint k = 0u; k < n; ++k) blend_splat(pixel, k, staged_row[k], center, left - k);
#endif
    }
    if (COUNT != 0u) {
        atomicAdd(pair_counts[BACKWARD_EVALUATED], evaluated);
        atomicAdd(pair_counts[BACKWARD_BLENDED], blended);
    }
}

#endif
