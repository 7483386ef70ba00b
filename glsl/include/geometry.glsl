// Shared by the passes of the geometry loss; include after the declaration of `prior`. With O = 1 - T, D = (sum w z) /
// O the depth and n the direction of sum w n, against the depth d and the normal p of a prior with confidence c, under
// a mask M:
//     depth    mean of Huber((D - d) / d) * E * c * (1 - M)
//     smooth   mean of squared second differences of D / median along rows and columns, times exp(-g |grad I|) * (1 - M)
//     normal   mean of (a (1 - n.p) + b |n - p|_1) * c * (1 - M)
// each over the pixels that have one: the first over those with both depths, the second with D, the third with both
// normals. A pixel has D if the photograph is not masked and O > 0.9. A second difference is 0 if one of its three
// pixels has no D.
#ifndef GEOMETRY_GLSL
#define GEOMETRY_GLSL
#include "place.glsl"

layout(push_constant) uniform Push {
    uint width;
    uint height;
    uint prior_width;
    uint prior_height;
    uint mask_width;
    uint mask_height;
    float pixels;         // of the photograph that are not masked
    float median;         // depth of the view, the unit of depth
    float depth_weight;
    float huber;          // residual at which the Huber function becomes linear
    float edge;           // see EDGES
    float smooth_weight;
    float edge_stop;      // g above
    float cosine_weight;  // a above
    float l1_weight;      // b above
} push;

const uint PIXELS_PER_THREAD = 64u;
const uint PIXELS_PER_GROUP = 64u * PIXELS_PER_THREAD;

const float OPAQUE = 0.9;
// Range of valid depths: bits of 1e-10 and 1e10.
const uint DEPTH_LEAST = 0x2edbe6ffu;
const uint DEPTH_MOST = 0x501502f9u;
// Depths of a prior that differ by more than this share belong to different surfaces.
const float PRIOR_JUMP = 0.1;
// Least length of a sum of normals that counts as a normal.
const float NORMAL_LEAST = 0.1;

bool is_depth(float x) {
    const uint bits = floatBitsToUint(x);
    return bits >= DEPTH_LEAST && bits <= DEPTH_MOST;
}

// Unit of depth for smoothness.
float unit_depth() { return max(push.median, 1e-6); }

Place prior_place(uvec2 at) {
    return place_in(at, uvec2(push.width, push.height), uvec2(push.prior_width, push.prior_height));
}

// The second word of a prior: a normal in an octahedron's coordinates of 12 bits each (0 to 4094; both 0: none), and 8
// bits of confidence.
float prior_confidence(uint word) { return float(word >> 24u) / 255.0; }
bool prior_has_normal(uint word) { return (word & 0xffffffu) != 0u; }

vec3 prior_normal(uint word) {
    const vec2 folded = vec2(word & 0xfffu, word >> 12u & 0xfffu) / 2047.0 - 1.0;
    const float z = 1.0 - abs(folded.x) - abs(folded.y);
    const vec2 sides = mix(vec2(-1.0), vec2(1.0), greaterThanEqual(folded, vec2(0.0)));
    return normalize(vec3(z >= 0.0 ? folded : (1.0 - abs(folded.yx)) * sides, z));
}

#endif
