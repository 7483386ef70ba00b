#version 460
// densify_scores: after a view's backward pass, adds to the scores for sampled growth, for every visible splat: the
// mask value weighted by the absolute gradient, and whether the render is wrong at the splat's centre. One thread owns
// one splat and its row of `scores`; one workgroup owns 64 consecutive splats.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 2) readonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 3) readonly buffer Grad2d { vec4 grad2d[]; };
layout(set = 0, binding = 4) readonly buffer Image { vec4 image[]; };
layout(set = 0, binding = 5) readonly buffer Target { uint target[]; };
layout(set = 0, binding = 6) readonly buffer Mask { float mask[]; };
layout(set = 0, binding = 7) buffer Scores { vec2 scores[]; };
layout(push_constant) uniform Push { uint width; uint height; uint masked; float error; } push;
#include "photograph.glsl"

void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS] || tile_counts[i] == 0u) return;
    const vec2 mean = LOAD4(splat2d, 3u * i).xy;
    const uint column = uint(clamp(mean.x, 0.0, float(push.width - 1u)));
    const uint row = uint(clamp(mean.y, 0.0, float(push.height - 1u)));
    const uint k = row * push.width + column;
    const Seen seen = photograph_at(k);
    const vec3 d = abs(LOAD4(image, k).rgb - seen.colour);
    const vec2 absolute = LOAD4(grad2d, 3u * i + 2u).zw * (0.5 * vec2(float(push.width), float(push.height)));
    vec2 s = scores[i];
    if (push.masked != 0u) s.x += mask[k] * sqrt(dot(absolute, absolute));
    if (seen.counts && d.r + d.g + d.b > 3.0 * push.error) s.y += 1.0;
    scores[i] = s;
}
