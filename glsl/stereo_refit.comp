#version 460
// stereo_refit: the slopes of a hypothesis are noisier than its depth. So the pass fits a plane to the neighbouring
// depths that lie near the pixel's own plane: weights fall to 0 at a relative difference of `tolerance` in inverse
// depth. Pixels without score (or, after the check, without confidence) are excluded. One thread owns a pixel; one
// workgroup owns 64 consecutive pixels.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "divide.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Kept { vec4 kept[]; };
layout(set = 0, binding = 1) writeonly buffer Refined { vec4 refined[]; };
layout(push_constant) uniform Push {
    uint width;
    uint height;
    uint reach;  // pixels to each side
    float tolerance;
} push;

const float RIDGE = 0.25;  // weight of the pixel's own slopes, in squared pixels

void main() {
    const uint pixel = global_index();
    if (pixel >= push.width * push.height) return;
    const uint y = quotient(pixel, push.width);
    const ivec2 at = ivec2(pixel - y * push.width, y);
    const vec4 own = LOAD4(kept, pixel);
    const float narrow = 1.0 / max(push.tolerance * own.x, 1e-30);
    const int reach = int(push.reach);
    // Sums of weights, of their first and second moments, and of the residuals to the pixel's own plane.
    vec3 moments = vec3(0.0);
    vec3 squares = vec3(0.0);
    vec3 rest = vec3(0.0);
    for (int dy = -reach; dy <= reach; ++dy) {
        for (int dx = -reach; dx <= reach; ++dx) {
            const ivec2 place = at + ivec2(dx, dy);
            const bool inside = place.x >= 0 && place.y >= 0 && place.x < int(push.width) && place.y < int(push.height);
            const ivec2 clamped = clamp(place, ivec2(0), ivec2(push.width, push.height) - 1);
            const vec4 other = LOAD4(kept, clamped.y * int(push.width) + clamped.x);
            const vec2 away = vec2(dx, dy);
            const float left = other.x - (own.x + dot(own.yz, away));
            const float near = max(1.0 - left * narrow * left * narrow, 0.0);
            const float weight = inside && other.w > 0.0 ? near * near : 0.0;
            moments += weight * vec3(1.0, away);
            squares += weight * vec3(away * away, away.x * away.y);
            rest += weight * left * vec3(1.0, away);
        }
    }
    const float share = 1.0 / max(moments.x, 1e-30);
    const vec2 mean = moments.yz * share;
    const vec2 spread = squares.xy * share - mean * mean + RIDGE;
    const float both = squares.z * share - mean.x * mean.y;
    const vec2 along = rest.yz * share - mean * rest.x * share;
    const vec2 slopes = vec2(along.x * spread.y - along.y * both, along.y * spread.x - along.x * both) /
        (spread.x * spread.y - both * both);
    const float d = own.x + rest.x * share - dot(slopes, mean);
    refined[pixel] = own.w > 0.0 && d > 0.0 ? vec4(d, own.yz + slopes, own.w) : own;
}
