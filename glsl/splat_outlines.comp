#version 460
// splat_outlines: per pixel (r, g, b, final transmittance) of the outlines of the splats, front to back, of the splats and lists of
// blend_forward. The outline of a splat is a line of about two pixels where its Mahalanobis distance is RADIUS, in the splat's colour; the
// inside is filled with FILL times the splat's Gaussian. Both are weighted by the splat's opacity.
// One thread owns a pixel; a workgroup of 64 threads owns a block of 8x8 pixels, which lies in one tile.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "alpha.glsl"
#include "common.glsl"
#include "loads.glsl"

layout(local_size_x = 64) in;
const float RADIUS = 2.0;
const float HALF_LINE = 1.25;  // pixels from the ellipse to where the line has faded
const float FILL = 0.1;
const uint BLOCK_SIDE = 8u;

layout(push_constant) uniform Push {
    uint width;
    uint height;
    uint side;  // of a tile, a multiple of BLOCK_SIDE
    float red;  // background
    float green;
    float blue;
} push;
layout(set = 0, binding = 0) readonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 1) readonly buffer SortedSplats { uint sorted_splats[]; };
layout(set = 0, binding = 2) readonly buffer TileRanges { uvec2 tile_ranges[]; };
layout(set = 0, binding = 3) writeonly buffer Image { vec4 image[]; };

// Alpha of the outline of a splat, whose first two rows these are, at d from its mean.
float outline(vec4 p, vec4 q, vec2 d) {
    // The squared distance as a sum of squares, as in conic_factor: it cannot be negative.
    const float along = d.x + p.w / p.z * d.y;
    const float distance = sqrt(max(p.z * along * along + q.w * d.y * d.y, 0.0));
    const vec2 slope = vec2(p.z * d.x + p.w * d.y, p.w * d.x + q.x * d.y);
    // Pixels to the ellipse, to first order; at the mean, where the distance has no slope, there is no line.
    const float pixels = abs(distance - RADIUS) * distance / max(length(slope), 1e-30);
    const float line = distance > 0.0 ? clamp(HALF_LINE - pixels, 0.0, 1.0) : 0.0;
    return q.y * max(line, FILL * exp(-0.5 * distance * distance));
}

void main() {
    const uint block_columns = (push.width + BLOCK_SIDE - 1u) / BLOCK_SIDE;
    const uvec2 corner = uvec2(group_index() % block_columns, group_index() / block_columns) * BLOCK_SIDE;
    const uvec2 at = corner + uvec2(local_index() % BLOCK_SIDE, local_index() / BLOCK_SIDE);
    if (at.x >= push.width || at.y >= push.height) return;
    const uint tile_columns = (push.width + push.side - 1u) / push.side;
    const uvec2 range = tile_ranges[at.y / push.side * tile_columns + at.x / push.side];
    float transmittance = 1.0;
    vec3 colour = vec3(0.0);
    for (uint k = range.x; k < range.y && transmittance > TRANSMITTANCE_MIN; ++k) {
        const uint splat = sorted_splats[k];
        const vec4 p = LOAD4(splat2d, 3u * splat);
        const vec4 q = LOAD4(splat2d, 3u * splat + 1u);
        const float alpha = min(outline(p, q, vec2(at) + 0.5 - p.xy), ALPHA_MAX);
        colour += alpha * transmittance * LOAD4(splat2d, 3u * splat + 2u).xyz;
        transmittance *= 1.0 - alpha;
    }
    image[at.y * push.width + at.x] = vec4(colour + transmittance * vec3(push.red, push.green, push.blue), transmittance);
}
