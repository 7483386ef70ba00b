#version 460
// geometry_grad: second half of the geometry loss (see geometry.glsl): adds to dL/dT in the gradient of the image, and
// writes the gradient of the auxiliary image. One thread owns 64 pixels, every 64th of the 4096 consecutive pixels of
// its workgroup, and one part: the pixels' weighted contributions to the three terms and to their sum.
//! texels
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "finite.glsl"
#include "loads.glsl"
layout(local_size_x = 64) in;
// Formula of E. 0: 1 + edge |grad I| / (|grad I| + mean |grad I|), more weight at edges; 1: exp(-edge |grad I|), less
// weight at edges.
layout(constant_id = 0) const uint EDGES = 0u;
layout(set = 0, binding = 0) readonly buffer Image { vec4 image[]; };
layout(set = 0, binding = 1) readonly buffer Aux { vec4 aux_image[]; };
layout(set = 0, binding = 2) readonly buffer Prior { uint prior[]; };
layout(set = 0, binding = 3) readonly buffer DepthMap { vec4 depth_map[]; };
layout(set = 0, binding = 4) readonly buffer Totals { vec4 totals[]; };
layout(set = 0, binding = 5) buffer GradImage { float grad_image[]; };
layout(set = 0, binding = 6) writeonly buffer GradAux { vec4 grad_aux_image[]; };
layout(set = 0, binding = 7) writeonly buffer Parts { vec4 parts[]; };
#include "geometry.glsl"

// Output of geometry_depth at (x, y); zeros outside the image.
vec4 map_at(int x, int y) {
    const bool inside = x >= 0 && y >= 0 && x < int(push.width) && y < int(push.height);
    const vec4 found = LOAD4(depth_map, inside ? uint(y) * push.width + uint(x) : 0u);
    return inside ? found : vec4(0.0);
}

float second_difference(vec4 before, vec4 here, vec4 after) {
    return before.x > 0.0 && here.x > 0.0 && after.x > 0.0 ? before.x - 2.0 * here.x + after.x : 0.0;
}

float smoothness(vec4 here) { return exp(-push.edge_stop * here.y) * here.z; }

// Derivative, with respect to the third of five pixels of a line, of the weighted squared second differences around
// pixels two to four; and the value around the third.
vec2 line(vec4 a, vec4 b, vec4 c, vec4 d, vec4 e) {
    const float before = smoothness(b) * second_difference(a, b, c);
    const float here = second_difference(b, c, d);
    const float weighted = smoothness(c) * here;
    const float after = smoothness(d) * second_difference(c, d, e);
    return vec2(weighted * here, 2.0 * (before - 2.0 * weighted + after));
}

float edge_weight(float edge, float mean) {
    if (EDGES != 0u) return exp(-push.edge * edge);
    return 1.0 + push.edge * edge / max(edge + mean, 1e-12);
}

void main() {
    const uint first = group_index() * PIXELS_PER_GROUP + local_index();
    const uint pixels = push.width * push.height;
    const vec4 total = LOAD4(totals, 0u);
    const vec3 each = vec3(push.smooth_weight, push.depth_weight, 1.0) / max(total.xyz, vec3(1.0));
    const float mean_edge = total.w / max(push.pixels, 1.0);
    vec4 part = vec4(0.0);
    for (uint i = 0u; i < PIXELS_PER_GROUP; i += 64u) {
        const uint k = first + i;
        if (k < pixels) {
            const uvec2 at = uvec2(k % push.width, k / push.width);
            const int x = int(at.x), y = int(at.y);
            const vec4 here = map_at(x, y);
            float of_transmittance = 0.0;
            vec4 of_aux = vec4(0.0);
            if (here.x > 0.0) {
                const float opacity = 1.0 - LOAD4(image, k).w;
                const float depth = here.x * unit_depth();
                const Place p = prior_place(at);
                const uint word = prior[2u * (p.nearest.y * push.prior_width + p.nearest.x) + 1u];
                const float trust = prior_confidence(word) * here.z;

                const vec2 along = line(map_at(x - 2, y), map_at(x - 1, y), here, map_at(x + 1, y), map_at(x + 2, y));
                const vec2 down = line(map_at(x, y - 2), map_at(x, y - 1), here, map_at(x, y + 1), map_at(x, y + 2));
                part.y += each.x * (along.x + down.x);
                float of_depth = each.x * (along.y + down.y) / unit_depth();

                if (here.w > 0.0) {
                    const float residual = (depth - here.w) / here.w;
                    const float held = clamp(residual, -push.huber, push.huber);
                    const float weight = each.y * edge_weight(here.y, mean_edge) * trust;
                    part.x += weight * held * (residual - 0.5 * held);
                    of_depth += weight * held / here.w;
                }
                of_aux.x = of_depth / opacity;
                of_transmittance = of_depth * depth / opacity;

                const vec3 sum = LOAD4(aux_image, k).yzw;
                const float size = length(sum);
                if (trust > 0.0 && prior_has_normal(word) && finite(sum) && size > NORMAL_LEAST) {
                    const vec3 normal = sum / size;
                    const vec3 wanted = prior_normal(word);
                    const vec3 off = normal - wanted;
                    const float weight = each.z * trust;
                    part.z += weight * (push.cosine_weight * (1.0 - dot(normal, wanted)) +
                                        push.l1_weight * (abs(off.x) + abs(off.y) + abs(off.z)));
                    const vec3 g = weight * (push.l1_weight * sign(off) - push.cosine_weight * wanted);
                    of_aux.yzw = (g - normal * dot(normal, g)) / size;
                }
            }
            grad_image[4u * k + 3u] += of_transmittance;
            grad_aux_image[k] = of_aux;
        }
    }
    part.w = part.x + part.y + part.z;
    parts[group_index() * 64u + local_index()] = part;
}
