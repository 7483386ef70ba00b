#version 460
// project_sparse: like project, with the same results, for devices that also execute branches that no thread takes.
// Splats that a bound on their extent proves to be out of view, most splats of a large scene, skip the projection. One
// workgroup, which is one subgroup of 8 threads, owns 64 consecutive splats: first each thread tests splats in turn for
// visibility, then each thread projects listed splats in turn. A culled splat (behind the near plane, off screen, too
// faint, not finite) gets a tile count of 0; its other outputs are not written.
//! texels means scales
#extension GL_GOOGLE_include_directive : require
#define LOCAL_SIZE 8
#include "subgroup.glsl"
#include "project.glsl"
layout(local_size_x = 8) in;

const uint CHUNK = 64u;
// A splat that may reach further, in pixels, is always projected. A splat within the reach has an aspect of at most
// 120, so the margin that tile.glsl subtracts from its conic stretches the splat by less than a thirtieth.
const float FAR_REACH = 160.0;
shared uint chosen[CHUNK];

// Coefficients of |w - ratio w2|^2 in powers of the ratio, for w a row of the camera's rotation and w2 its third.
vec3 squared_row(vec3 w, vec3 w2) { return vec3(dot(w, w), -2.0 * dot(w, w2), dot(w2, w2)); }

// Upper bound of the dilated variance along an axis of the image: the squared length of a row of J W R S, with R a
// rotation and every scale replaced by the largest.
float most_variance(vec3 squared, float ratio, float spread) {
    return (squared.x + ratio * (squared.y + ratio * squared.z)) * spread * spread + DILATION;
}

// False only for a splat that project_splat culls and that is finite.
bool may_be_seen(Camera camera, vec3 across, vec3 down, float deviations, uint i) {
    const vec3 mean = LOAD3(means, i);
    const vec3 log_scale = LOAD3(scales, i);
    const bool known = finite(mean) && finite(log_scale) && finite(LOAD4(quats, i)) && finite(opacities[i]);
    const vec3 p = to_camera(camera, mean);
    const vec3 at_pivot = pivot(p);
    const vec2 ratio = clamp(at_pivot.xy / at_pivot.z, camera.limits.xz, camera.limits.yw);
    const vec2 at = on_image(camera, p);
    const vec2 spread = camera.focal / at_pivot.z * exp(max(log_scale.x, max(log_scale.y, log_scale.z)));
    const vec2 variance = vec2(most_variance(across, ratio.x, spread.x), most_variance(down, ratio.y, spread.y));
    const vec2 reach = deviations * sqrt(variance) + 1.0;
    // Written so that the test is true for non-finite values.
    const bvec2 before = lessThan(at + reach, vec2(0.0));
    const bvec2 after = greaterThan(at - reach, vec2(push.width, push.height));
    const bool outside = any(before) || any(after);
    const bool behind = p.z <= camera.near;
    return !known || !(behind || (outside && max(reach.x, reach.y) < FAR_REACH));
}

void main() {
    const Camera camera = camera_from_push();
    const vec3 across = squared_row(camera.w0, camera.w2);
    const vec3 down = squared_row(camera.w1, camera.w2);
    // Standard deviations from the centre of an opaque splat to alpha = ALPHA_MIN, plus a twentieth for the margins of
    // tile.glsl and rounding.
    const float deviations = 1.05 * sqrt(-2.0 * log(ALPHA_MIN));
    const uint lane = subgroup_lane();
    const uint width = subgroup_width();
    const uint splats = counters[COUNTER_SPLATS];
    const uint first = group_index() * CHUNK;

    // Both loops test at their end, see common.glsl.
    uint count = 0u;
    uint offset = 0u;
    do {
        const uint i = first + offset + lane;
        bool maybe = false;
        if (i < splats) {
            maybe = may_be_seen(camera, across, down, deviations, i);
            if (!maybe) tile_counts[i] = 0u;
        }
        const uint place = count + subgroup_exclusive_add(uint(maybe));
        if (maybe) chosen[place] = i;
        count = subgroup_broadcast(place + uint(maybe), width - 1u);
        offset += width;
    } while (offset < CHUNK);
    subgroup_meet();
    uint k = lane;
    do {
        if (k < count) project_splat(camera, chosen[k]);
        k += width;
    } while (k < count);
}
