// Agreement of a window of the reference with the sources under a hypothesis: bilateral NCC (weights by distance and by
// difference of luma, as in COLMAP and ACMM), through the exact homography of the hypothesis' plane.
//
// A hypothesis at a pixel is (d, gx, gy): inverse depth at the pixel, and its change per pixel, which is constant on a
// plane. The including shader declares STEP, SIDE (taps along a side of the window), `blocks` (pixel p of the
// photograph in slot s is row s * push.stride + p; slot 0 is the reference), `links` and `push`. A source has seven
// rows of `links`: three rows of (A, b), which map pixel (u, v) at inverse depth d to A (u, v, 1) + b d in homogeneous
// pixels of the source; one row with width and height; and three rows of the inverse map.
#ifndef STEREO_WINDOW_GLSL
#define STEREO_WINDOW_GLSL

const uint LINK_ROWS = 7u;
const uint TAPS = SIDE * SIDE;
const int REACH = int((SIDE - 1u) * STEP / 2u);
// Variance of luma (from 0 to 1) caused by 8-bit quantisation alone; below, a window has no texture.
const float LEAST_VARIANCE = 4e-6;

// Independent of hypotheses: weights that sum to 1, and the weights times the reference's deviations in units of their
// root mean square.
float weights[TAPS];
float pattern[TAPS];
float pivot;

ivec2 tap_offset(uint x, uint y) { return ivec2(x * STEP, y * STEP) - REACH; }

// Whether the window has texture to compare.
bool load_window(ivec2 at) {
    const ivec2 size = ivec2(push.width, push.height);
    const float centre = LOAD4(blocks, at.y * size.x + at.x).x;
    vec3 sums = vec3(0.0);
    [[unroll]] for (uint y = 0u; y < SIDE; ++y) {
        [[unroll]] for (uint x = 0u; x < SIDE; ++x) {
            const ivec2 offset = tap_offset(x, y);
            const ivec2 tap = at + offset;
            const bool inside = tap.x >= 0 && tap.y >= 0 && tap.x < size.x && tap.y < size.y;
            const ivec2 clamped = clamp(tap, ivec2(0), size - 1);
            const float difference = LOAD4(blocks, clamped.y * size.x + clamped.x).x - centre;
            const vec2 away = vec2(offset);
            const float weight = exp(-(dot(away, away) * push.by_distance + difference * difference * push.by_luma));
            weights[y * SIDE + x] = inside ? weight : 0.0;
            pattern[y * SIDE + x] = difference;
            sums += weights[y * SIDE + x] * vec3(1.0, difference, difference * difference);
        }
    }
    const float share = 1.0 / sums.x;
    const float mean = sums.y * share;
    const float variance = sums.z * share - mean * mean;
    const float scale = inversesqrt(max(variance, LEAST_VARIANCE));
    pivot = centre + mean;
    [[unroll]] for (uint t = 0u; t < TAPS; ++t) {
        weights[t] *= share;
        pattern[t] = weights[t] * (pattern[t] - mean) * scale;
    }
    return variance >= LEAST_VARIANCE;
}

// 1 + NCC with one source, from 0 to 2; negative where the middle of the window is outside of the source or behind it.
float source_score(uint source, vec3 hypothesis, vec2 middle) {
    const uint first = source * LINK_ROWS;
    const vec4 row_x = LOAD4(links, first);
    const vec4 row_y = LOAD4(links, first + 1u);
    const vec4 row_z = LOAD4(links, first + 2u);
    const vec4 size = LOAD4(links, first + 3u);
    const vec4 here = vec4(middle, 1.0, hypothesis.x);
    const vec3 centre = vec3(dot(row_x, here), dot(row_y, here), dot(row_z, here));
    const vec3 along_x = vec3(row_x.x, row_y.x, row_z.x) + vec3(row_x.w, row_y.w, row_z.w) * hypothesis.y;
    const vec3 along_y = vec3(row_x.y, row_y.y, row_z.y) + vec3(row_x.w, row_y.w, row_z.w) * hypothesis.z;
    const vec2 at = centre.xy / centre.z;
    const bool seen = centre.z > 0.0 && at.x >= 0.0 && at.y >= 0.0 && at.x <= size.x && at.y <= size.y;
    const uint slot = (source + 1u) * push.stride;
    const vec2 last = size.xy - 1.0;
    const uint width = uint(size.x);
    float shared_sum = 0.0;
    float sum = 0.0;
    float squares = 0.0;
    [[unroll]] for (uint y = 0u; y < SIDE; ++y) {
        [[unroll]] for (uint x = 0u; x < SIDE; ++x) {
            const vec2 offset = vec2(tap_offset(x, y));
            const vec3 h = centre + offset.x * along_x + offset.y * along_y;
            const vec2 uv = clamp(h.xy / max(h.z, 1e-12) - 0.5, vec2(0.0), last);
            const vec2 corner = floor(uv);
            const vec2 f = uv - corner;
            const vec4 block = LOAD4(blocks, slot + uint(corner.y) * width + uint(corner.x)) - pivot;
            const vec2 ends = mix(block.xz, block.yw, f.x);
            const float value = mix(ends.x, ends.y, f.y);
            const uint t = y * SIDE + x;
            shared_sum += pattern[t] * value;
            sum += weights[t] * value;
            squares += weights[t] * value * value;
        }
    }
    const float variance = squares - sum * sum;
    const float ncc = shared_sum * inversesqrt(max(variance, LEAST_VARIANCE));
    const float score = variance >= LEAST_VARIANCE ? clamp(1.0 + ncc, 0.0, 2.0) : 0.0;
    return seen ? score : -1.0;
}

// Mean of the best scores among the sources that contain the point: occlusion in some sources does not count against
// the hypothesis.
float window_score(vec3 hypothesis, vec2 middle) {
    vec4 best = vec4(0.0);
    uint seen = 0u;
    if (push.sources > 0u) {
        // The loop tests at its end, see common.glsl.
        uint source = 0u;
        do {
            float score = source_score(source, hypothesis, middle);
            seen += score >= 0.0 ? 1u : 0u;
            [[unroll]] for (uint k = 0u; k < 4u; ++k) {
                const float higher = max(best[k], score);
                score = min(best[k], score);
                best[k] = higher;
            }
            ++source;
        } while (source < push.sources);
    }
    const uint most = clamp(seen, 1u, push.best);
    const uvec4 counted = uvec4(lessThan(uvec4(0u, 1u, 2u, 3u), uvec4(most)));
    return dot(best, vec4(counted)) / float(most);
}

#endif
