// Position of an image's pixel centre in a map of another size that covers the same view. In integers, so that the
// nearest pixel and the weights do not depend on rounding.
#ifndef PLACE_GLSL
#define PLACE_GLSL

struct Place {
    uvec2 low;      // pixel of the map at or before the position, per axis
    uvec2 high;     // the next pixel, per axis
    vec2 share;     // weight of `high`
    uvec2 nearest;  // pixel of the map that contains the position
};

Place place_in(uvec2 at, uvec2 size, uvec2 map) {
    const ivec2 unit = ivec2(2u * size);
    const ivec2 last = ivec2(map) - 1;
    const ivec2 center = (2 * ivec2(at) + 1) * ivec2(map);
    const ivec2 t = clamp(center - ivec2(size), ivec2(0), last * unit);
    const ivec2 low = t / unit;
    return Place(uvec2(low), uvec2(min(low + 1, last)), vec2(t - low * unit) / vec2(unit), uvec2(center / unit));
}

#endif
