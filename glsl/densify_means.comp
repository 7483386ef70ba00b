#version 460
// densify_means: the means after a density change. Children of a split are drawn from the parent's Gaussian (3DGS), or
// placed on both sides of the parent's mean along its longest axis or the axis from `densify_axes`. Every other row
// keeps the mean of its source. The draw's key is (seed, event, identity of the parent, which child). One thread owns
// one new row; one workgroup owns 64 consecutive rows. Runs before scales and rotations are moved.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "densify.glsl"
#include "random.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Map { uint map[]; };
layout(set = 0, binding = 2) readonly buffer OldIds { uint old_ids[]; };
layout(set = 0, binding = 3) readonly buffer Source { uint source[]; };
layout(set = 0, binding = 4) readonly buffer Quats { float quats[]; };
layout(set = 0, binding = 5) readonly buffer Scales { float scales[]; };
layout(set = 0, binding = 6) writeonly buffer Means { uint means[]; };
layout(push_constant) uniform Push { uint seed; uint event; uint along_axis; } push;

vec3 rotate(vec4 q, vec3 v) {
    precise float norm = sqrt(((q.x * q.x + q.y * q.y) + q.z * q.z) + q.w * q.w);
    precise float scale = 1.0 / max(norm, 1e-12);
    precise float w = q.x * scale;
    precise float x = q.y * scale;
    precise float y = q.z * scale;
    precise float z = q.w * scale;
    precise float a = ((1.0 - 2.0 * (y * y + z * z)) * v.x + (2.0 * (x * y - w * z)) * v.y) + (2.0 * (x * z + w * y)) * v.z;
    precise float b = ((2.0 * (x * y + w * z)) * v.x + (1.0 - 2.0 * (x * x + z * z)) * v.y) + (2.0 * (y * z - w * x)) * v.z;
    precise float c = ((2.0 * (x * z - w * y)) * v.x + (2.0 * (y * z + w * x)) * v.y) + (1.0 - 2.0 * (x * x + y * y)) * v.z;
    return vec3(a, b, c);
}

void main() {
    const uint row = global_index();
    if (row >= counters[COUNTER_SCAN_TOTAL]) return;
    const uint entry = map[row];
    const uint i = map_source(entry);
    const uint kind = map_kind(entry);
    uvec3 mean = uvec3(source[3u * i], source[3u * i + 1u], source[3u * i + 2u]);
    if (kind == KIND_CHILD_A || kind == KIND_CHILD_B) {
        vec3 place = random_normals(uvec4(push.seed, push.event, old_ids[i], kind - KIND_CHILD_A));
        if (push.along_axis != 0u) {
            const uint axis = map_axis(entry, scales[3u * i], scales[3u * i + 1u], scales[3u * i + 2u]);
            const float offset = kind == KIND_CHILD_A ? AXIS_OFFSET : -AXIS_OFFSET;
            place = vec3(axis == 0u ? offset : 0.0, axis == 1u ? offset : 0.0, axis == 2u ? offset : 0.0);
        }
        precise vec3 local = place * vec3(random_exp(scales[3u * i]), random_exp(scales[3u * i + 1u]), random_exp(scales[3u * i + 2u]));
        const vec4 q = vec4(quats[4u * i], quats[4u * i + 1u], quats[4u * i + 2u], quats[4u * i + 3u]);
        precise vec3 moved = uintBitsToFloat(mean) + rotate(q, local);
        mean = floatBitsToUint(moved);
    }
    means[3u * row] = mean.x;
    means[3u * row + 1u] = mean.y;
    means[3u * row + 2u] = mean.z;
}
