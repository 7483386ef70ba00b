#version 460
// geometry_depth: first half of the geometry loss (see geometry.glsl): per pixel the depth over the median (0: none),
// |grad I| of the photograph's luma, 1 - M (0 where the photograph is masked) and the depth of the prior (0: none). One
// thread owns 64 pixels, every 64th of the 4096 consecutive pixels of its workgroup, and one part: the number of pixels
// with a depth, with depth and prior, with both normals, and the sum of |grad I|.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "finite.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
// 0: no mask, M = 0.
layout(constant_id = 0) const uint MASK = 0u;
layout(set = 0, binding = 0) readonly buffer Image { vec4 image[]; };
layout(set = 0, binding = 1) readonly buffer Aux { vec4 aux_image[]; };
layout(set = 0, binding = 2) readonly buffer Target { uint target[]; };
layout(set = 0, binding = 3) readonly buffer Prior { uint prior[]; };
layout(set = 0, binding = 4) readonly buffer Mask { uint mask[]; };
layout(set = 0, binding = 5) writeonly buffer DepthMap { vec4 depth_map[]; };
layout(set = 0, binding = 6) writeonly buffer Parts { vec4 parts[]; };
#include "geometry.glsl"
#include "luma.glsl"
#include "mask.glsl"
#include "photograph.glsl"

float luma_at(uint x, uint y) { return luma(photograph_at(y * push.width + x).colour); }

// Half the difference of the neighbours; a border pixel is its own neighbour.
float edge_at(uvec2 at) {
    const uvec2 before = at - min(at, uvec2(1u));
    const uvec2 after = min(at + 1u, uvec2(push.width, push.height) - 1u);
    return 0.5 * length(vec2(luma_at(after.x, at.y) - luma_at(before.x, at.y), luma_at(at.x, after.y) - luma_at(at.x, before.y)));
}

// Inverse depth of the prior at one of its pixels, or `nearest` if the pixel has no depth or another surface.
float inverse_depth(uint x, uint y, float nearest) {
    const float depth = uintBitsToFloat(prior[2u * (y * push.prior_width + x)]);
    return 1.0 / (is_depth(depth) && abs(depth - nearest) <= PRIOR_JUMP * nearest ? depth : nearest);
}

// Inverse depth is linear in pixels over a plane, so inverse depths are interpolated.
float prior_depth(Place p) {
    const float nearest = uintBitsToFloat(prior[2u * (p.nearest.y * push.prior_width + p.nearest.x)]);
    if (!is_depth(nearest)) return 0.0;
    const float above = mix(inverse_depth(p.low.x, p.low.y, nearest), inverse_depth(p.high.x, p.low.y, nearest), p.share.x);
    const float below = mix(inverse_depth(p.low.x, p.high.y, nearest), inverse_depth(p.high.x, p.high.y, nearest), p.share.x);
    return 1.0 / mix(above, below, p.share.y);
}

void main() {
    const uint first = group_index() * PIXELS_PER_GROUP + local_index();
    const uint pixels = push.width * push.height;
    vec4 part = vec4(0.0);
    for (uint i = 0u; i < PIXELS_PER_GROUP; i += 64u) {
        const uint k = first + i;
        if (k < pixels) {
            const uvec2 at = uvec2(k % push.width, k / push.width);
            const bool counts = photograph_at(k).counts;
            const float edge = counts ? edge_at(at) : 0.0;
            const vec4 sums = LOAD4(aux_image, k);
            const float opacity = 1.0 - LOAD4(image, k).w;
            const float depth = sums.x / max(opacity, 1e-3);
            const bool has_depth = counts && opacity > OPAQUE && finite(opacity) && is_depth(depth);

            const Place p = prior_place(at);
            const uint word = prior[2u * (p.nearest.y * push.prior_width + p.nearest.x) + 1u];
            const bool trusted = has_depth && prior_confidence(word) > 0.0;
            const float wanted = trusted ? prior_depth(p) : 0.0;
            const bool has_normals = trusted && prior_has_normal(word) && finite(sums) && length(sums.yzw) > NORMAL_LEAST;

            float kept = counts ? 1.0 : 0.0;
            if (MASK != 0u) kept *= 1.0 - mask_at(at, uvec2(push.width, push.height), uvec2(push.mask_width, push.mask_height));
            depth_map[k] = vec4(has_depth ? depth / unit_depth() : 0.0, edge, kept, wanted);
            part += vec4(has_depth, wanted > 0.0, has_normals, edge);
        }
    }
    parts[group_index() * 64u + local_index()] = part;
}
