#version 460
// project_backward: gradients of every splat's parameters from the gradients of its 2D Gaussian (columns of grad2d).
// One thread owns one splat; one workgroup owns 64 consecutive splats. A culled splat (tile count 0) gets zeros.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "projection.glsl"
#include "sh.glsl"
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint AUX = 0u;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Means { float means[]; };
layout(set = 0, binding = 2) readonly buffer Quats { vec4 quats[]; };
layout(set = 0, binding = 3) readonly buffer Scales { float scales[]; };
layout(set = 0, binding = 4) readonly buffer Opacities { float opacities[]; };
layout(set = 0, binding = 5) readonly buffer Sh0 { vec4 sh0[]; };
layout(set = 0, binding = 6) readonly buffer Sh1 { vec4 sh1[]; };
layout(set = 0, binding = 7) readonly buffer Sh2 { vec4 sh2[]; };
layout(set = 0, binding = 8) readonly buffer Sh3 { vec4 sh3[]; };
layout(set = 0, binding = 9) readonly buffer Splat2d { vec4 splat2d[]; };
layout(set = 0, binding = 10) readonly buffer TileCounts { uint tile_counts[]; };
layout(set = 0, binding = 11) readonly buffer Grad2d { vec4 grad2d[]; };
layout(set = 0, binding = 12) readonly buffer GradNormals { vec4 grad_normals[]; };
layout(set = 0, binding = 13) writeonly buffer GMeans { float g_means[]; };
layout(set = 0, binding = 14) writeonly buffer GQuats { vec4 g_quats[]; };
layout(set = 0, binding = 15) writeonly buffer GScales { float g_scales[]; };
layout(set = 0, binding = 16) writeonly buffer GOpacities { float g_opacities[]; };
layout(set = 0, binding = 17) writeonly buffer GSh0 { vec4 g_sh0[]; };
layout(set = 0, binding = 18) writeonly buffer GSh1 { vec4 g_sh1[]; };
layout(set = 0, binding = 19) writeonly buffer GSh2 { vec4 g_sh2[]; };
layout(set = 0, binding = 20) writeonly buffer GSh3 { vec4 g_sh3[]; };

// A group of SH gradients is the outer product of its basis values and the colour's gradient.
#define WRITE_SH(plane, basis)                                        \
    plane[s] = vec4((basis).x * g_rgb, (basis).y * g_rgb.x);          \
    plane[s + 1u] = vec4((basis).y * g_rgb.yz, (basis).z * g_rgb.xy); \
    plane[s + 2u] = vec4((basis).z * g_rgb.z, (basis).w * g_rgb)
#define READ_SH(plane) sh_dot(g_rgb, plane[s], plane[s + 1u], plane[s + 2u])

void write_geometry(uint i, vec3 g_mean, vec4 g_quat, vec3 g_scale, float g_opacity) {
    g_means[3u * i] = g_mean.x;
    g_means[3u * i + 1u] = g_mean.y;
    g_means[3u * i + 2u] = g_mean.z;
    g_quats[i] = g_quat;
    g_scales[3u * i] = g_scale.x;
    g_scales[3u * i + 1u] = g_scale.y;
    g_scales[3u * i + 2u] = g_scale.z;
    g_opacities[i] = g_opacity;
}

void main() {
    const uint i = global_index();
    if (i >= counters[COUNTER_SPLATS]) return;
    const uint s = 3u * i;
    if (tile_counts[i] == 0u) {
        const vec3 g_rgb = vec3(0.0);
        write_geometry(i, vec3(0.0), vec4(0.0), vec3(0.0), 0.0);
        WRITE_SH(g_sh0, vec4(0.0));
        WRITE_SH(g_sh1, vec4(0.0));
        WRITE_SH(g_sh2, vec4(0.0));
        WRITE_SH(g_sh3, vec4(0.0));
        return;
    }

    const Camera camera = camera_from_push();
    const vec3 mean = vec3(means[s], means[s + 1u], means[s + 2u]);
    const vec4 quat = quats[i];
    const vec3 log_scale = vec3(scales[s], scales[s + 1u], scales[s + 2u]);
    const vec3 p = to_camera(camera, mean);
    const Ewa e = ewa_project(camera, p, quat, log_scale);
    const vec4 grad_a = grad2d[s];       // mean x, mean y, A, B
    const vec4 grad_b = grad2d[s + 1u];  // C, opacity, r, g
    const vec4 grad_c = grad2d[s + 2u];  // b, depth, abs x, abs y

    // Colour: max(0, .) passes no gradient where the stored colour is 0.
    const vec3 stored = splat2d[s + 2u].xyz;
    const vec3 g_rgb = mix(vec3(0.0), vec3(grad_b.zw, grad_c.x), greaterThan(stored, vec3(0.0)));
    const uint degree = push.sh_degree;
    const vec3 offset = mean - camera.center;
    const float distance = length(offset);
    const vec3 dir = offset / distance;
    vec3 g_dir = sh_slope0(READ_SH(sh0), degree);
    WRITE_SH(g_sh0, sh_basis0(dir, degree));
    if (degree >= 2u) {
        g_dir += sh_slope1(dir, READ_SH(sh1)) + sh_slope2(dir, READ_SH(sh2), degree);
        WRITE_SH(g_sh1, sh_basis1(dir));
        WRITE_SH(g_sh2, sh_basis2(dir, degree));
    } else {
        WRITE_SH(g_sh1, vec4(0.0));
        WRITE_SH(g_sh2, vec4(0.0));
    }
    if (degree >= 3u) {
        g_dir += sh_slope3(dir, READ_SH(sh3));
        WRITE_SH(g_sh3, sh_basis3(dir));
    } else {
        WRITE_SH(g_sh3, vec4(0.0));
    }

    // Opacity, with the anti-aliasing factor between the sigmoid and what is blended.
    const vec2 sigma = sigmoid(opacities[i]);
    const bool antialias = view_has(VIEW_ANTIALIAS);
    const float g_opacity = grad_b.y * sigma.y * (antialias ? e.compensation : 1.0);
    const float g_compensation = antialias ? grad_b.y * sigma.x : 0.0;

    vec3 g_axis = vec3(0.0);
    uint axis = 0u;
    if (AUX != 0u) {
        axis = shortest_axis(log_scale);
        float side;
        splat_normal(camera, p, e.rot, axis, side);
        const vec3 g_normal = side * grad_normals[i].xyz;
        g_axis = camera.w0 * g_normal.x + camera.w1 * g_normal.y + camera.w2 * g_normal.z;
    }
    EwaGrad g = ewa_backward(camera, e, p.z, vec3(grad_a.zw, grad_b.x), g_compensation, g_axis, axis,
                             view_has(VIEW_REFERENCE_CLAMP));
    g.p.xy += grad_a.xy * e.zoom;
    g.p.z += grad_c.y - dot(grad_a.xy * e.zoom, p.xy / p.z);

    const vec3 g_mean = camera.w0 * g.p.x + camera.w1 * g.p.y + camera.w2 * g.p.z
                        + (g_dir - dir * dot(dir, g_dir)) / distance;
    write_geometry(i, g_mean, g.quat, g.log_scale, g_opacity);
}
