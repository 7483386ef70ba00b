// What the density passes share: the kinds of row that a density change produces, packed into one word of the map.
// Rows come in the order kept, clones, first children, second children, each in the order of their sources.
#ifndef DENSIFY_GLSL
#define DENSIFY_GLSL

const uint KIND_KEPT = 0u;
const uint KIND_CLONE = 1u;
const uint KIND_CHILD_A = 2u;
const uint KIND_CHILD_B = 3u;
const uint KIND_COUNT = 4u;

// Children of a split have 1 / 1.6 of the parent's standard deviations (3DGS: 0.8 N with N = 2 children).
const float LN_SPLIT_SHRINK = 0.47000363;

uint map_entry(uint source, uint kind) { return source | (kind << 30u); }
uint map_source(uint entry) { return entry & 0x3fffffffu; }
uint map_kind(uint entry) { return entry >> 30u; }

#endif
