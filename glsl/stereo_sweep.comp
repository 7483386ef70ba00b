#version 460
// stereo_sweep: PatchMatch for a list of pixels of the reference (propagation over a checkerboard with eight arms as in
// ACMH, Xu and Tao 2019; random refinement). A sweep updates pixels of one colour from pixels of the other colour. The
// first call for a view (FLAG_START) scores, at every pixel, the given hypothesis and random hypotheses. One thread
// owns a pixel of the list; one workgroup owns 64 consecutive ones.
//! texels
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common.glsl"
#include "divide.glsl"
#include "loads.glsl"
#include "random.glsl"
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint STEP = 2u;  // pixels between taps of the window
layout(constant_id = 1) const uint SIDE = 5u;  // taps along a side of the window
layout(set = 0, binding = 0) readonly buffer Blocks { vec4 blocks[]; };
layout(set = 0, binding = 1) readonly buffer Links { vec4 links[]; };
layout(set = 0, binding = 2) readonly buffer Pixels { uint pixels[]; };
layout(set = 0, binding = 3) buffer Planes { vec4 planes[]; };  // hypothesis and its score; score 0 for no hypothesis
layout(push_constant) uniform Push {
    uint width;
    uint height;
    uint stride;   // pixels from one photograph to the next in `blocks`
    uint sources;  // at most 4
    uint best;     // number of best sources that count, from 1 to 4
    uint first;    // of the pixels in the list
    uint count;
    uint turn;  // number of the call, for random draws
    uint seed;
    uint draws;  // random hypotheses
    uint flags;
    float focal_x;
    float focal_y;
    float centre_x;
    float centre_y;
    float least;      // range of inverse depths
    float most;
    float amplitude;  // of random changes of the inverse depth
    float slope;      // of random changes of its slopes
    float by_distance;
    float by_luma;
    float facing;  // least cosine between the plane's normal and the ray
} push;
#include "stereo_window.glsl"

const uint FLAG_START = 1u;
const uint ARMS = 8u;
const float TILT = 1.5;  // largest slope of random planes against the image plane

// From -1 to 1, 1 excluded.
vec4 spread(uvec4 bits) { return vec4(bits >> 8u) * (1.0 / 8388608.0) - 1.0; }

// Whether a hypothesis is in range and faces the camera.
bool possible(vec3 hypothesis, vec2 middle) {
    const vec3 ray = vec3((middle.x - push.centre_x) / push.focal_x, (middle.y - push.centre_y) / push.focal_y, 1.0);
    vec3 p = vec3(hypothesis.y * push.focal_x, hypothesis.z * push.focal_y, 0.0);
    p.z = hypothesis.x - p.x * ray.x - p.y * ray.y;
    const float d = hypothesis.x;
    return d >= push.least && d <= push.most && d * d >= push.facing * push.facing * dot(p, p) * dot(ray, ray);
}

// The neighbour with the highest score on an arm, as (hypothesis propagated to the pixel, score). Near arms are the
// adjacent pixel and three diverging pairs; far arms are eleven pixels in a line, from the third on.
vec4 arm(uint number, ivec2 at) {
    const uint side = number & 3u;
    const ivec2 ahead = side == 0u ? ivec2(0, -1) : side == 1u ? ivec2(0, 1) : side == 2u ? ivec2(-1, 0) : ivec2(1, 0);
    const bool far = number >= 4u;
    const uint places = far ? 11u : 7u;
    vec4 found = vec4(0.0);
    // The loop tests at its end, see common.glsl.
    uint k = 0u;
    do {
        const int out_by = int((k + 1u) >> 1u);
        const int across = (k & 1u) == 0u ? out_by : -out_by;
        const ivec2 offset = far ? ahead * int(3u + 2u * k) : ahead * (1 + out_by) + ahead.yx * across;
        const ivec2 away = far || k > 0u ? offset : ahead;
        const ivec2 place = at + away;
        const bool inside = place.x >= 0 && place.y >= 0 && place.x < int(push.width) && place.y < int(push.height);
        const ivec2 clamped = clamp(place, ivec2(0), ivec2(push.width, push.height) - 1);
        const vec4 plane = LOAD4(planes, clamped.y * int(push.width) + clamped.x);
        const bool better = inside && plane.w > found.w;
        const vec4 carried = vec4(plane.x - plane.y * float(away.x) - plane.z * float(away.y), plane.yzw);
        found = better ? carried : found;
        ++k;
    } while (k < places);
    return found;
}

// A random hypothesis anywhere in the range.
vec3 random_plane(vec4 draw) {
    const float d = mix(push.least, push.most, 0.5 + 0.5 * draw.x);
    return vec3(d, d * TILT * draw.y / push.focal_x, d * TILT * draw.z / push.focal_y);
}

// A random hypothesis near the given one: changes depth, slope, or both, in turn.
vec3 changed(vec3 hypothesis, uint draw_number, vec4 draw) {
    const uint kind = draw_number % 3u;
    const vec2 slopes = kind == 0u ? hypothesis.yz : hypothesis.yz + push.slope * draw.yz;
    return vec3(kind == 1u ? hypothesis.x : hypothesis.x + push.amplitude * draw.x, slopes);
}

void main() {
    const uint index = global_index();
    if (index >= push.count) return;
    const uint pixel = pixels[push.first + index];
    const uint y = quotient(pixel, push.width);
    const ivec2 at = ivec2(pixel - y * push.width, y);
    const vec2 middle = vec2(at) + 0.5;
    const bool textured = load_window(at);
    const bool start = (push.flags & FLAG_START) != 0u;
    vec4 held = LOAD4(planes, pixel);
    const vec3 given = held.xyz;
    if (start) held = vec4(0.0);
    const uint others = start ? 1u : ARMS;
    // At least one; the loop tests at its end, see common.glsl.
    uint c = 0u;
    do {
        const vec4 draw = spread(random_bits(uvec4(pixel, c, push.turn, push.seed)));
        vec3 hypothesis;
        if (c >= others) {
            hypothesis = start ? random_plane(draw) : changed(held.xyz, c - others, draw);
        } else {
            hypothesis = start ? given : arm(c, at).xyz;
        }
        const float score = window_score(hypothesis, middle);
        if (textured && possible(hypothesis, middle) && score > held.w) held = vec4(hypothesis, score);
        ++c;
    } while (c < others + push.draws);
    planes[pixel] = held;
}
