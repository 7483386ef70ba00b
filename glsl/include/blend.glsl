// Shared by blend_forward and blend_backward: constants, push constants, tiles, and the splat in the blending loops.
#ifndef BLEND_GLSL
#define BLEND_GLSL

#include "alpha.glsl"
#include "common.glsl"
#include "loads.glsl"

layout(constant_id = 0) const uint AUX = 0u;    // 1: blend depth and normal too
layout(constant_id = 1) const uint COUNT = 0u;  // 1: count evaluated and blended (pixel, splat) pairs

layout(push_constant) uniform Push {
    uint width;
    uint height;
    float red;  // background
    float green;
    float blue;
} push;

// Entries of pair_counts.
const uint FORWARD_EVALUATED = 0u;
const uint FORWARD_BLENDED = 1u;
const uint BACKWARD_EVALUATED = 2u;
const uint BACKWARD_BLENDED = 3u;

// A dispatch folded over two axes can have a few extra workgroups, with tile numbers past the last.
uint tile_columns(uint side) { return (push.width + side - 1u) / side; }
uint tile_total(uint side) { return tile_columns(side) * ((push.height + side - 1u) / side); }
uvec2 tile_corner(uint tile, uint side) { return uvec2(tile % tile_columns(side), tile / tile_columns(side)) * side; }

// A row of splat2d, the conic as its factor (p, q, r), see alpha.glsl; and its normal and slope when AUX.
struct Splat {
    float x, y;
    float p, q, r;
    float opacity;
    float depth;  // of the centre
    vec3 colour;
    vec3 normal;
    vec2 slope;   // of the depth, per pixel
};

#endif
