#version 460
// depth_probe: per pixel (median depth, front, behind, final transmittance), of the splats, lists and decisions of blend_forward.
// The median depth is that of the splat, at the pixel, at which the transmittance falls to 0.5 or below, 0 where it never does. Front and
// behind are the sums of the weights of splats nearer than 0.98 and farther than 1.02 times the known depth, 0 where none is known.
// One thread owns a pixel; a workgroup of 64 threads owns a block of 8x8 pixels, which lies in one tile.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "alpha.glsl"
#include "common.glsl"
#include "loads.glsl"

layout(local_size_x = 64) in;
layout(constant_id = 0) const uint KNOWN = 0u;  // 1: depths are known
const float FRONT = 0.98;
const float BEHIND = 1.02;
const float MEDIAN = 0.5;
const uint BLOCK_SIDE = 8u;

layout(push_constant) uniform Push {
    uint width;
    uint height;
    uint side;  // of a tile, a multiple of BLOCK_SIDE
} push;
layout(set = 0, binding = 0) readonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 1) readonly buffer Normals { vec4 normals[]; };
layout(set = 0, binding = 2) readonly buffer SortedSplats { uint sorted_splats[]; };
layout(set = 0, binding = 3) readonly buffer TileRanges { uvec2 tile_ranges[]; };
layout(set = 0, binding = 4) readonly buffer KnownDepths { float known_depths[]; };
layout(set = 0, binding = 5) writeonly buffer Probe { vec4 probe[]; };

// Alpha of a splat, whose first two rows these are, at the centre of a pixel.
float alpha_at(vec4 p, vec4 q, vec2 center) {
    const vec3 factor = conic_factor(p.z, p.w, q.w);
    precise float along = factor.x * (center.x - p.x);
    return min(unclamped_alpha(exponent(conic_roots(along, factor.y, factor.z, center.y - p.y)), q.y), ALPHA_MAX);
}

void main() {
    const uint block_columns = (push.width + BLOCK_SIDE - 1u) / BLOCK_SIDE;
    const uvec2 corner = uvec2(group_index() % block_columns, group_index() / block_columns) * BLOCK_SIDE;
    const uvec2 at = corner + uvec2(local_index() % BLOCK_SIDE, local_index() / BLOCK_SIDE);
    if (at.x >= push.width || at.y >= push.height) return;
    const uint pixel = at.y * push.width + at.x;
    const uint tile_columns = (push.width + push.side - 1u) / push.side;
    const uvec2 range = tile_ranges[at.y / push.side * tile_columns + at.x / push.side];
    const float known = KNOWN != 0u ? known_depths[pixel] : 0.0;
    float transmittance = 1.0;
    float median = 0.0;
    vec2 off = vec2(0.0);
    for (uint k = range.x; k < range.y; ++k) {
        const uint splat = sorted_splats[k];
        const vec4 p = LOAD4(splat2d, 3u * splat);
        const vec4 q = LOAD4(splat2d, 3u * splat + 1u);
        const vec2 center = vec2(at) + 0.5;
        const vec2 slope = vec2(LOAD4(splat2d, 3u * splat + 2u).w, LOAD4(normals, splat).w);
        const float depth = q.z + dot(slope, center - p.xy);
        const float alpha = alpha_at(p, q, center);
        const float next = attenuate(transmittance, alpha);
        if (next < TRANSMITTANCE_MIN) break;
        if (known > 0.0) off += alpha * transmittance * vec2(lessThan(vec2(depth, BEHIND * known), vec2(FRONT * known, depth)));
        if (transmittance > MEDIAN && next <= MEDIAN) median = depth;
        transmittance = next;
    }
    probe[pixel] = vec4(median, off, transmittance);
}
