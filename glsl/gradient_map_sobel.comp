#version 460
// gradient_map_sobel: first pass of the gradient-map loss (see gradient_map.glsl): per pixel the magnitudes a and b and
// the render's gradient; a = -1 for an excluded pixel. One thread owns a pixel, a workgroup 64 consecutive ones.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "gradient_map.glsl"
#include "loads.glsl"
#include "luma.glsl"
layout(local_size_x = 64) in;
// 1: b is of another render in place of the photograph.
layout(constant_id = 3) const uint OTHER = 0u;
layout(set = 0, binding = 0) readonly buffer Image { vec4 image[]; };
layout(set = 0, binding = 1) readonly buffer Target { uint target[]; };
layout(set = 0, binding = 2) readonly buffer Other { vec4 other[]; };
layout(set = 0, binding = 3) writeonly buffer Maps { vec4 maps[]; };
#include "photograph.glsl"

// Luma of the render and of what it is compared with; that of the photograph for both where the pixel is masked.
vec2 lumas(uint k) {
    const Seen seen = photograph_at(k);
    const float wanted = luma(seen.colour);
    vec2 both = vec2(seen.counts ? luma(LOAD4(image, k).rgb) : wanted, wanted);
    if (OTHER != 0u) both.y = seen.counts ? luma(LOAD4(other, k).rgb) : wanted;
    return both;
}

void main() {
    const uint k = global_index();
    if (k >= push.width * push.height) return;
    const uvec2 at = uvec2(k % push.width, k / push.width);
    const bool inside = at.x > 0u && at.y > 0u && at.x + 1u < push.width && at.y + 1u < push.height;
    vec4 row = vec4(-1.0, 0.0, 0.0, 0.0);
    if (inside && photograph_at(k).counts) {
        const uint above = k - push.width, below = k + push.width;
        const vec2 nw = lumas(above - 1u), n = lumas(above), ne = lumas(above + 1u);
        const vec2 w = lumas(k - 1u), e = lumas(k + 1u);
        const vec2 sw = lumas(below - 1u), s = lumas(below), se = lumas(below + 1u);
        const vec2 gx = (ne - nw) + 2.0 * (e - w) + (se - sw);
        const vec2 gy = (sw - nw) + 2.0 * (s - n) + (se - ne);
        const vec2 size = sqrt(gx * gx + gy * gy + ROOT_FLOOR);
        row = vec4(size, gx.x, gy.x);
    }
    maps[k] = row;
}
