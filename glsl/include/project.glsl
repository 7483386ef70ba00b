// The body of project and of its variants: projects one splat. HALF: sh coefficients in half floats.
#include "camera_push.glsl"
#include "common.glsl"
#include "counters.glsl"
#include "loads.glsl"
#include "projection.glsl"
#include "sh.glsl"
#include "tile.glsl"
layout(constant_id = 0) const uint TILE_W = 16u;
layout(constant_id = 1) const uint TILE_H = 16u;
layout(constant_id = 2) const uint AUX = 0u;
layout(constant_id = 3) const uint ORTHOGRAPHIC = 0u;  // 1: rays are parallel to z, focal is pixels per scene unit
layout(set = 0, binding = 0) buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Means { float means[]; };
layout(set = 0, binding = 2) readonly buffer Quats { vec4 quats[]; };
layout(set = 0, binding = 3) readonly buffer Scales { float scales[]; };
layout(set = 0, binding = 4) readonly buffer Opacities { float opacities[]; };
#ifdef HALF
#include "sh_halves.glsl"
#else
#include "sh_planes.glsl"
#endif
layout(set = 0, binding = 9) writeonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 10) writeonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 11) writeonly buffer Normals { vec4 normals[]; };

// Parts of a pixel to which positions under parallel rays are rounded, before the principal point, a whole number, is
// added. The sum is then exact, so a splat's distance from a pixel is the same in every window of a map.
const float PIXEL_STEPS = 1024.0;

// The camera-frame point at which the Jacobian is taken: under parallel rays it is that of a point on the axis.
vec3 pivot(vec3 p) { return ORTHOGRAPHIC != 0u ? vec3(0.0, 0.0, 1.0) : p; }

// Position on the image of a camera-frame point.
vec2 on_image(Camera camera, vec3 p) {
    if (ORTHOGRAPHIC != 0u) return roundEven(camera.focal * p.xy * PIXEL_STEPS) / PIXEL_STEPS + camera.principal;
    return camera.focal * (p.xy / p.z) + camera.principal;
}

// Direction in the scene from the camera to a splat.
vec3 direction_to(Camera camera, vec3 mean) {
    return ORTHOGRAPHIC != 0u ? camera.w2 : normalize(mean - camera.center);
}

// Conditions nest, rather than return early, because a software rasterizer keeps a mask of the threads that have
// returned.
void project_splat(Camera camera, uint i) {
    const vec3 mean = LOAD3(means, i);
    const vec4 quat = LOAD4(quats, i);
    const vec3 log_scale = LOAD3(scales, i);
    const float logit = opacities[i];
    bool bad = !(finite(mean) && finite(quat) && finite(log_scale) && finite(logit));
    const vec3 p = to_camera(camera, mean);
    uint tiles = 0u;
    if (!bad && p.z > camera.near) {
        const Ewa e = ewa_project(camera, pivot(p), quat, log_scale);
        const vec2 at = on_image(camera, p);
        float opacity = sigmoid(logit).x;
        if (view_has(VIEW_ANTIALIAS)) opacity *= e.compensation;
        // Overflowed values do not tell the splat's position.
        if (finite(at) && finite(e.conic) && finite(e.det) && finite(p.z) && opacity >= ALPHA_MIN) {
            tiles = count_tiles(at, e.conic, opacity, TileGrid(uvec2(push.width, push.height), uvec2(TILE_W, TILE_H)));
        }
        if (tiles > 0u) {
            const uint degree = i < FULL_ROWS ? push.sh_degree : min(push.sh_degree, 1u);
            const vec3 dir = direction_to(camera, mean);
            const uint s = 3u * i;
            vec3 colour = vec3(0.5) + sh_sum(sh_basis0(dir, degree), LOAD_SH(sh0, s), LOAD_SH(sh0, s + 1u), LOAD_SH(sh0, s + 2u));
            if (degree >= 2u) {
                colour += sh_sum(sh_basis1(dir), LOAD_SH(sh1, s), LOAD_SH(sh1, s + 1u), LOAD_SH(sh1, s + 2u));
                colour += sh_sum(sh_basis2(dir, degree), LOAD_SH(sh2, s), LOAD_SH(sh2, s + 1u), LOAD_SH(sh2, s + 2u));
            }
            if (degree >= 3u) colour += sh_sum(sh_basis3(dir), LOAD_SH(sh3, s), LOAD_SH(sh3, s + 1u), LOAD_SH(sh3, s + 2u));
            bad = !finite(colour);
            if (bad) {
                tiles = 0u;
            } else {
                splat2d[s] = vec4(at, e.conic.xy);
                splat2d[s + 1u] = vec4(e.conic.z, opacity, p.z, e.rest);
                const vec2 slope = AUX != 0u ? depth_slope(e) : vec2(0.0);
                splat2d[s + 2u] = vec4(max(colour, vec3(0.0)), slope.x);
                if (AUX != 0u) {
                    float side;
                    normals[i] = vec4(splat_normal(camera, pivot(p), e.rot, shortest_axis(log_scale), side), slope.y);
                }
            }
        }
    }
    tile_counts[i] = tiles;
    if (bad) atomicAdd(counters[COUNTER_BAD_SPLATS], 1u);
}
