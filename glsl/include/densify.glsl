// Shared by the density passes: the kinds of row after a density change, packed into one word of the map. Rows come in
// the order kept, clones, first children, second children, each in the order of their sources. A kept source with a
// second child becomes the first child, with its row and identity.
#ifndef DENSIFY_GLSL
#define DENSIFY_GLSL

const uint KIND_KEPT = 0u;
const uint KIND_CLONE = 1u;
const uint KIND_CHILD_A = 2u;
const uint KIND_CHILD_B = 3u;
const uint KIND_COUNT = 4u;

// Children of a split have 1 / 1.6 of the parent's standard deviations (3DGS: 0.8 N with N = 2 children).
const float LN_SPLIT_SHRINK = 0.47000363;

// Children along an axis are half a standard deviation from the parent's mean and have sqrt(3/4) of the parent's
// standard deviation along the axis: together they have the parent's covariance.
const float AXIS_OFFSET = 0.5;
const float LN_AXIS_SHRINK = 0.14384104;
// Inverse of a child's falloff at the parent's mean: exp((1/2)(1/4)/(3/4)).
const float INVERSE_AXIS_CENTER = 1.18136041;

// The longest axis, the first of equals.
uint longest_axis(float x, float y, float z) {
    return x >= y && x >= z ? 0u : y >= z ? 1u : 2u;
}

uint map_entry(uint source, uint kind) { return source | (kind << 30u); }
// An entry with the split axis; 0 stands for the longest axis.
uint map_along(uint entry, uint axis) { return (entry & 0xcfffffffu) | (axis + 1u) << 28u; }
uint map_source(uint entry) { return entry & 0x0fffffffu; }
uint map_kind(uint entry) { return entry >> 30u; }
uint map_axis(uint entry, float x, float y, float z) {
    const uint noted = entry >> 28u & 3u;
    return noted == 0u ? longest_axis(x, y, z) : noted - 1u;
}

#endif
