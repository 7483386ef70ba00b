// Splats of a batch in shared memory, in rows: a row takes one access instead of one per word. Include after the shape
// and the splat's definition.
#ifndef STAGED_GLSL
#define STAGED_GLSL

shared vec4 staged_place[BATCH];   // x, y, p, q
shared vec4 staged_look[BATCH];    // r, opacity, red, green
shared vec2 staged_rest[BATCH];    // blue, depth
shared vec4 staged_normal[BATCH];  // normal, slope x; only with AUX
shared float staged_slope[BATCH];  // slope y; only with AUX

void stage(uint k, Splat s) {
    staged_place[k] = vec4(s.x, s.y, s.p, s.q);
    staged_look[k] = vec4(s.r, s.opacity, s.colour.rg);
    staged_rest[k] = vec2(s.colour.b, s.depth);
    if (AUX != 0u) {
        staged_normal[k] = vec4(s.normal, s.slope.x);
        staged_slope[k] = s.slope.y;
    }
}

Splat staged(uint k) {
    const vec4 place = staged_place[k];
    const vec4 look = staged_look[k];
    const vec2 rest = staged_rest[k];
    const vec4 normal = AUX != 0u ? staged_normal[k] : vec4(0.0);
    const vec2 slope = AUX != 0u ? vec2(normal.w, staged_slope[k]) : vec2(0.0);
    return Splat(place.x, place.y, place.z, place.w, look.x, look.y, rest.y, vec3(look.zw, rest.x), normal.xyz, slope);
}

#endif
