#version 460
// gradient_map_grad: last pass of the gradient-map loss (see gradient_map.glsl): adds the loss's gradient to the
// gradient of the image. One thread owns 64 pixels, every 64th of the 4096 consecutive pixels of its workgroup, and one
// part: (correlation term, variation of the residual, mean correlation, both terms), weighted. The very first thread
// adds the windows' terms.
//! texels
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common.glsl"
#include "gradient_map.glsl"
#include "loads.glsl"
#include "luma.glsl"
layout(local_size_x = 64) in;
// 0: leaves out the residual's variation.
layout(constant_id = 0) const uint VARIATION = 1u;
layout(set = 0, binding = 0) readonly buffer Image { vec4 image[]; };
layout(set = 0, binding = 1) readonly buffer Target { uint target[]; };
layout(set = 0, binding = 2) readonly buffer Maps { vec4 maps[]; };
layout(set = 0, binding = 3) readonly buffer Totals { vec4 totals[]; };
layout(set = 0, binding = 4) buffer GradImage { vec4 grad_image[]; };
layout(set = 0, binding = 5) writeonly buffer Parts { vec4 parts[]; };
#include "photograph.glsl"

const uint PIXELS_PER_GROUP = 4096u;

// One comparison instead of a short-circuited chain, on which some compilers hang.
bool inside(ivec2 at) { return all(lessThan(uvec2(at), uvec2(push.width, push.height))); }
uint place(ivec2 at) { return uint(at.y) * push.width + uint(at.x); }

// Render minus photograph, and 1; zeros outside the image and at masked pixels.
vec4 residual(ivec2 at) {
    const bool there = inside(at);
    const uint k = mix(0u, place(at), there);
    const Seen seen = photograph_at(k);
    const bvec2 all_of = bvec2(there, seen.counts);
    return mix(vec4(0.0), vec4(LOAD4(image, k).rgb - seen.colour, 1.0), bvec4(all(all_of)));
}

vec3 step_to(vec4 from, vec4 to) { return from.w * to.w * (to.rgb - from.rgb); }

// Adds, to the derivative with respect to luma at a pixel, the part through the gradient at the neighbour `off` pixels
// away.
void add_flow(inout float sum, ivec2 at, ivec2 off) {
    const bool there = inside(at + off);
    const vec2 flow = LOAD4(maps, mix(0u, place(at + off), there)).xy;
    const vec2 factor = vec2(off) * vec2(2 - abs(off.yx));
    sum -= mix(0.0, dot(flow, factor), there);
}

void main() {
    const uint first = group_index() * PIXELS_PER_GROUP + local_index();
    const uint pixels = push.width * push.height;
    const vec4 total = LOAD4(totals, 0u);
    const bool some = total.y > 0.0;
    const float scale = some ? -push.weight / total.y : 0.0;
    const float each = push.tv_weight / push.values;
    vec4 part = vec4(0.0);
    if (first == 0u && some) part = vec4(push.weight * (1.0 - total.x / total.y), 0.0, total.x / total.y, 0.0);
    for (uint i = 0u; i < PIXELS_PER_GROUP; i += 64u) {
        const uint k = first + i;
        if (k < pixels) {
            const ivec2 at = ivec2(k % push.width, k / push.width);
            float of_luma = 0.0;
            [[unroll]] for (int y = -1; y <= 1; ++y) {
                [[unroll]] for (int x = -1; x <= 1; ++x) {
                    if (x != 0 || y != 0) add_flow(of_luma, at, ivec2(x, y));
                }
            }
            vec3 grad = scale * of_luma * LUMA;
            if (VARIATION != 0u) {
                const vec4 here = residual(at);
                const vec4 left = residual(at + ivec2(-1, 0)), up = residual(at + ivec2(0, -1));
                const vec3 x = step_to(here, residual(at + ivec2(1, 0)));
                const vec3 y = step_to(here, residual(at + ivec2(0, 1)));
                const vec3 x_left = step_to(left, here), y_left = step_to(left, residual(at + ivec2(-1, 1)));
                const vec3 x_up = step_to(up, residual(at + ivec2(1, -1))), y_up = step_to(up, here);
                const vec3 size = sqrt(x * x + y * y + ROOT_FLOOR);
                part.y += here.w * each * (size.r + size.g + size.b);
                grad += each * (x_left / sqrt(x_left * x_left + y_left * y_left + ROOT_FLOOR) +
                                y_up / sqrt(x_up * x_up + y_up * y_up + ROOT_FLOOR) - (x + y) / size);
            }
            const vec4 before = LOAD4(grad_image, k);
            grad_image[k] = vec4(before.rgb + (photograph_at(k).counts ? grad : vec3(0.0)), before.w);
        }
    }
    part.w = part.x + part.y;
    parts[group_index() * 64u + local_index()] = part;
}
