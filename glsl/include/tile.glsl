// The ellipse-tile test: finds the tiles of the image with a pixel centre where a splat has alpha >= ALPHA_MIN.
// `project` counts with it, and `emit` or `tile_edges` and `emit_tiles` list with it, all from the stored row of `splat2d`, so they always agree.
// Idea: exact opacity-aware tile lists, Speedy-Splat (SnugBox, AccuTile). Twin: src/twin/tile.rs, same operations in
// the same order.
//
// With q(d) = A dx^2 + 2 B dx dy + C dy^2, alpha = opacity exp(-q/2) >= ALPHA_MIN means q <= t = 2 ln(opacity /
// ALPHA_MIN). For the rows of pixel centres of one tile row, d_y in [d0, d1], the columns with q <= t form an interval
//     dx in [c - w, c + w],  c = -B dy / A,  w = sqrt(A t - det dy^2) / A,  det = A C - B^2,
// whose right end is concave in dy with its top at the ellipse's rightmost point: the largest value over the tile row
// is found at that point clamped to [d0, d1]; likewise the left end. Nothing is listed whose interval holds no column
// of pixel centres.
//
// Margins (u = 2^-24), all outward, so that no tile is lost in which a pixel passes in f32:
//  - Blending evaluates q/2 in f32 as (p dx + q dy)^2 + (r dy)^2 from p = sqrt(A/2), q = B/(2p), r (see alpha.glsl). With P = |p dx|,
//    Q = |q dy|, R = |r dy|, P^2 + Q^2 + R^2 = (A dx^2 + C dy^2) / 2. Where roots have 9u and divisions 5u (2.5 ulp), p has 10u, q 17u
//    and the first square 2 (P + Q) (12u P + 20u Q) + 2u (P + Q)^2, less than 70u (P^2 + Q^2). So the test uses
//    q - delta (A dx^2 + C dy^2), which is q with A and C scaled by 1 - delta, delta = 2^-17 = 128u; what remains is more than the
//    rounding of the scaled A and C and of det (5u of A C), and the different roundings of C and R. For needles with an aspect over
//    about 350 the scaled form may be indefinite, and the formulas list their band across the image.
//  - t carries + 2^-14: errors of ln, exp (14 ulp), of the quotient, of the product with the opacity, and of the difference under the root (8u of A t).
//  - ends of intervals carry 2^-20 of the numbers they were added from (16u against at most 10u of rounding: division and root
//    with up to 2.5 ulp each; a misplaced top of the concave function costs at most 8u of the extent).
#ifndef TILE_GLSL
#define TILE_GLSL

#include "alpha_min.glsl"

const float TILE_SHRINK = 1.0 - 1.0 / 131072.0;    // 1 - 2^-17
const float TILE_LEVEL_MARGIN = 1.0 / 16384.0;     // 2^-14
const float TILE_END_MARGIN = 1.0 / 1048576.0;     // 2^-20
const float TILE_FAR = 1.0e9;                      // a mean further than this from the origin, in pixels, lists nothing
const float TILE_UNBOUNDED = 1.0e18;

struct TileGrid {
    uvec2 image;  // width, height in pixels
    uvec2 tile;   // width, height of a tile in pixels: powers of two
};

// Pixels as tiles, rounded down. By shifts, because CPU devices divide integers lane by lane.
uvec2 in_tiles(uvec2 pixels, uvec2 tile) { return pixels >> findLSB(tile); }

// Values shared by all rows of one splat. Rows of tiles [row_begin, row_end); empty when the splat touches no tile.
struct TileEllipse {
    vec2 mean;
    float inv_a;    // 1 / A
    float b;
    float a_t;      // A t
    float det;      // A C - B^2
    float extent_y; // half height of the ellipse, with its margin
    float top_y;    // dy of the rightmost point; the leftmost point is its mirror image
    uint row_begin;
    uint row_end;
};

uvec2 tile_counts_of(TileGrid grid) { return in_tiles(grid.image + grid.tile - 1u, grid.tile); }

// ln x for normal x > 0, by operations with the same rounding everywhere: the twin gets the same bits.
float tile_ln(float x) {
    const uint bits = floatBitsToUint(x);
    precise float m = uintBitsToFloat((bits & 0x007fffffu) | 0x3f800000u);
    precise float e = float(int(bits >> 23) - 127);
    if (m > 1.41421354) {
        m = m * 0.5;
        e = e + 1.0;
    }
    precise float inv = 1.0 / (m + 1.0);
    precise float s = (m - 1.0) * inv;
    precise float z = s * s;
    precise float series = 1.0 + z * (0.333333343 + z * (0.2 + z * (0.142857149 + z * 0.111111112)));
    precise float result = e * 0.693147182 + (s + s) * series;
    return result;
}

// Pixels [begin, end) of an axis of `pixels` whose centres lie in [low, high], as tiles [begin, end).
uvec2 tile_span(float low, float high, uint pixels, uint tile) {
    precise float first = clamp(ceil(low - 0.5), 0.0, float(pixels));
    precise float last = clamp(floor(high - 0.5), -1.0, float(pixels) - 1.0);
    if (!(first <= last)) return uvec2(0u);
    return in_tiles(uvec2(first, last), uvec2(tile)) + uvec2(0u, 1u);
}

TileEllipse tile_ellipse(vec2 mean, vec3 conic, float opacity, TileGrid grid) {
    TileEllipse e;
    e.mean = mean;
    e.inv_a = 0.0;
    e.b = 0.0;
    e.a_t = 0.0;
    e.det = 0.0;
    e.extent_y = 0.0;
    e.top_y = 0.0;
    e.row_begin = 0u;
    e.row_end = 0u;
    precise float scaled = opacity / ALPHA_MIN;
    // Written so that NaN fails the test.
    const bool sound = conic.x > 1.0e-30 && conic.x < 1.0e15 && conic.z > 1.0e-30 && conic.z < 1.0e15 && abs(conic.y) < 1.0e15
        && abs(mean.x) < TILE_FAR && abs(mean.y) < TILE_FAR && scaled > 0.5 && scaled < 1.0e6;
    if (!sound) return e;
    precise float t = 2.0 * tile_ln(scaled) + TILE_LEVEL_MARGIN;
    if (!(t > 0.0)) return e;
    precise float a = conic.x * TILE_SHRINK;
    precise float c = conic.z * TILE_SHRINK;
    precise float b = conic.y;
    precise float det = a * c - b * b;
    precise float a_t = a * t;
    precise float extent = TILE_UNBOUNDED;
    // An indefinite form is monotone in dy: its largest dx is at the end of the row's range that -B points to.
    precise float top = b > 0.0 ? -TILE_UNBOUNDED : TILE_UNBOUNDED;
    if (det > 0.0) {
        precise float inv_det = 1.0 / det;
        precise float inv_c = 1.0 / c;
        extent = min(sqrt(a_t * inv_det) * (1.0 + TILE_END_MARGIN), TILE_UNBOUNDED);
        precise float widest = sqrt((c * t) * inv_det);
        top = clamp(-(b * inv_c) * widest, -TILE_UNBOUNDED, TILE_UNBOUNDED);
    }
    precise float slack = TILE_END_MARGIN * (abs(mean.y) + extent);
    precise float low = (mean.y - extent) - slack;
    precise float high = (mean.y + extent) + slack;
    const uvec2 rows = tile_span(low, high, grid.image.y, grid.tile.y);
    precise float inv_a = 1.0 / a;
    e.inv_a = inv_a;
    e.b = b;
    e.a_t = a_t;
    e.det = det;
    e.extent_y = extent;
    e.top_y = top;
    e.row_begin = rows.x;
    e.row_end = rows.y;
    return e;
}

// The ellipse of a splat from the first two vectors of its row of `splat2d`.
TileEllipse ellipse_of(vec4 p, vec4 q, TileGrid grid) { return tile_ellipse(p.xy, vec3(p.zw, q.x), q.y, grid); }

// Columns of tiles [begin, end) that the splat touches in a row of tiles; begin = end when none.
uvec2 tile_row(TileEllipse e, uint row, TileGrid grid) {
    precise float y0 = float(row * grid.tile.y) + 0.5;
    precise float y1 = float(min((row + 1u) * grid.tile.y, grid.image.y)) - 0.5;
    precise float d0 = max(y0 - e.mean.y, -e.extent_y);
    precise float d1 = min(y1 - e.mean.y, e.extent_y);
    if (!(d0 <= d1)) return uvec2(0u);
    precise float dy_right = clamp(e.top_y, d0, d1);
    precise float dy_left = clamp(-e.top_y, d0, d1);
    precise float c_right = -(e.b * dy_right) * e.inv_a;
    precise float c_left = -(e.b * dy_left) * e.inv_a;
    precise float w_right = sqrt(max(e.a_t - e.det * (dy_right * dy_right), 0.0)) * e.inv_a;
    precise float w_left = sqrt(max(e.a_t - e.det * (dy_left * dy_left), 0.0)) * e.inv_a;
    precise float slack_right = TILE_END_MARGIN * (abs(e.mean.x) + (abs(c_right) + w_right));
    precise float slack_left = TILE_END_MARGIN * (abs(e.mean.x) + (abs(c_left) + w_left));
    precise float high = (e.mean.x + (c_right + w_right)) + slack_right;
    precise float low = (e.mean.x + (c_left - w_left)) - slack_left;
    return tile_span(low, high, grid.image.x, grid.tile.x);
}

// Tiles that a splat touches. `mean`, `conic` = (A, B, C) and `opacity` must be the very bits stored in `splat2d`.
uint count_tiles(vec2 mean, vec3 conic, float opacity, TileGrid grid) {
    const TileEllipse e = tile_ellipse(mean, conic, opacity, grid);
    uint count = 0u;
    if (e.row_begin < e.row_end) {
        // The loop tests at its end, see common.glsl.
        uint row = e.row_begin;
        do {
            const uvec2 columns = tile_row(e, row, grid);
            count += columns.y - columns.x;
            ++row;
        } while (row < e.row_end);
    }
    return count;
}

#endif
