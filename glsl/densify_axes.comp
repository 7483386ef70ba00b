#version 460
// densify_axes: chooses the axis along which each split separates its children: the axis of the parent along which the
// loss changes most over a standard deviation, by the optimiser's mean gradient of the mean. (In progressive spectral
// residual splatting, arXiv 2503.00848, new splats follow the gradient; along an axis both children together keep the
// mean and covariance of the parent.) For a zero gradient nothing is noted, and the split uses the longest axis. One
// thread owns one new row and its entry of the map; one workgroup owns 64 consecutive rows. Runs before any plane is
// moved.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "densify.glsl"
#include "random.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Quats { float quats[]; };
layout(set = 0, binding = 2) readonly buffer Scales { float scales[]; };
layout(set = 0, binding = 3) readonly buffer Moments { uint moments[]; };  // of the centres
layout(set = 0, binding = 4) buffer Map { uint map[]; };
layout(push_constant) uniform Push { uint packed_moments; } push;

const uint V_SHIFT = 15u;  // see packed_moments.glsl

float mean_gradient(uint word) {
    if (push.packed_moments == 0u) return uintBitsToFloat(word);
    return unpackHalf2x16(word).x * sqrt(uintBitsToFloat(word >> 16u << V_SHIFT));
}

// Dot product of a vector with a column of the rotation, times the squared length of the quaternion.
float along(vec3 column, vec3 v) {
    precise float sum = (column.x * v.x + column.y * v.y) + column.z * v.z;
    return abs(sum);
}

void main() {
    const uint row = global_index();
    if (row >= counters[COUNTER_SCAN_TOTAL]) return;
    const uint entry = map[row];
    const uint kind = map_kind(entry);
    if (kind != KIND_CHILD_A && kind != KIND_CHILD_B) return;
    const uint i = map_source(entry);
    const float w = quats[4u * i];
    const float x = quats[4u * i + 1u];
    const float y = quats[4u * i + 2u];
    const float z = quats[4u * i + 3u];
    const vec3 gradient = vec3(mean_gradient(moments[3u * i]), mean_gradient(moments[3u * i + 1u]), mean_gradient(moments[3u * i + 2u]));
    precise vec3 first = vec3((w * w + x * x) - (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y));
    precise vec3 second = vec3(2.0 * (x * y - w * z), (w * w + y * y) - (x * x + z * z), 2.0 * (y * z + w * x));
    precise vec3 third = vec3(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), (w * w + z * z) - (x * x + y * y));
    precise float a = along(first, gradient) * random_exp(scales[3u * i]);
    precise float b = along(second, gradient) * random_exp(scales[3u * i + 1u]);
    precise float c = along(third, gradient) * random_exp(scales[3u * i + 2u]);
    const uint axis = longest_axis(a, b, c);
    const float most = axis == 0u ? a : axis == 1u ? b : c;
    if (most > 0.0) map[row] = map_along(entry, axis);
}
