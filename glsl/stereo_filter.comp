#version 460
// stereo_filter: keeps hypotheses that several views agree on (the geometric check of COLMAP and ACMM). A pixel's point
// is projected to a source; the source's own depth there gives another point, which must project back to nearly the
// same pixel at nearly the same depth. One thread owns a pixel of the reference; one workgroup owns 64 consecutive
// pixels.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "divide.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Planes { vec4 planes[]; };  // slot 0: reference; slot s + 1: source s
layout(set = 0, binding = 1) readonly buffer Links { vec4 links[]; };
layout(set = 0, binding = 2) writeonly buffer Kept { vec4 kept[]; };  // hypothesis and confidence; zeros if rejected
layout(push_constant) uniform Push {
    uint width;
    uint height;
    uint stride;   // pixels from one photograph to the next in `planes`
    uint sources;
    uint needed;   // sources that must agree
    float pixels;  // least distance of disagreement
    float depth;   // least relative depth difference of disagreement
    float score;   // least score, 1 + NCC
} push;

const uint LINK_ROWS = 7u;

vec3 applied(uint row, vec4 at) {
    return vec3(dot(LOAD4(links, row), at), dot(LOAD4(links, row + 1u), at), dot(LOAD4(links, row + 2u), at));
}

void main() {
    const uint pixel = global_index();
    if (pixel >= push.width * push.height) return;
    const uint y = quotient(pixel, push.width);
    const vec2 middle = vec2(pixel - y * push.width, y) + 0.5;
    const vec4 plane = LOAD4(planes, pixel);
    uint agree = 0u;
    for (uint source = 0u; source < push.sources; ++source) {
        const uint first = source * LINK_ROWS;
        const vec3 there = applied(first, vec4(middle, 1.0, plane.x));
        const vec2 size = LOAD4(links, first + 3u).xy;
        const float z = max(there.z, 1e-12);
        const vec2 at = there.xy / z;
        const bool seen = there.z > 0.0 && at.x >= 0.0 && at.y >= 0.0 && at.x < size.x && at.y < size.y;
        const vec2 nearest = clamp(floor(at), vec2(0.0), size - 1.0);
        const uint row = (source + 1u) * push.stride + uint(nearest.y) * uint(size.x) + uint(nearest.x);
        const vec4 other = LOAD4(planes, row);
        // The source's surface at the exact position, not at the pixel centre.
        const float d = other.x + dot(other.yz, at - nearest - 0.5);
        const vec3 back = applied(first + 4u, vec4(at, 1.0, d));
        const vec2 apart = back.xy / max(back.z, 1e-12) - middle;
        // Ratio of the depth of the reference's point in the source to the source's own depth: z / plane.x against 1 /
        // d.
        const float ratio = z * d / max(plane.x, 1e-30);
        const bool close = dot(apart, apart) < push.pixels * push.pixels && abs(ratio - 1.0) < push.depth && back.z > 0.0;
        agree += seen && close && other.w > 0.0 && d > 0.0 ? 1u : 0u;
    }
    const bool stays = plane.x > 0.0 && plane.w > 0.0 && plane.w >= push.score && agree >= push.needed;
    const float confidence = clamp(plane.w - 1.0, 0.0, 1.0) * float(agree) / float(agree + 1u);
    kept[pixel] = stays && confidence > 0.0 ? vec4(plane.xyz, confidence) : vec4(0.0);
}
