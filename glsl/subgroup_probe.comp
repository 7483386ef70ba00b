#version 460
//! variant subgroup
//! variant emulated SUBGROUP_EMULATED
// subgroup_probe: every operation of subgroup.glsl and workgroup_sum.glsl on one word per thread, for tests of a
// device. One thread owns one word and 12 words of results; a workgroup owns 128 consecutive words.
#extension GL_GOOGLE_include_directive : require
#define LOCAL_SIZE 128
#include "subgroup.glsl"
#include "workgroup_sum.glsl"
#include "common.glsl"
layout(local_size_x = LOCAL_SIZE) in;
layout(set = 0, binding = 0) readonly buffer Source { uint source[]; };
layout(set = 0, binding = 1) writeonly buffer Results { uint results[]; };
layout(push_constant) uniform Push {
    uint width;  // expected subgroup width
} push;
void main() {
    const uint i = group_index() * LOCAL_SIZE + workgroup_rank();
    const uint x = source[i];
    const bool odd = (x & 1u) != 0u;
    const uvec4 ballot = subgroup_ballot(odd);
    const vec4 parts = subgroup_add(vec4(uvec4(x, x >> 8, x >> 16, x >> 24) & 255u));
    const uvec4 sums = uvec4(parts);
    uint total;
    const uint before = workgroup_exclusive_add(x, total);
    uint row[12];
    row[0] = subgroup_add(x);
    row[1] = subgroup_exclusive_add(x);
    row[2] = subgroup_max(x);
    row[3] = subgroup_shuffle(x, subgroup_lane() ^ 3u);
    row[4] = floatBitsToUint(subgroup_broadcast(uintBitsToFloat(x & 0x3fffffffu), 5u));
    row[5] = ballot_before(ballot);
    row[6] = ballot_count(ballot);
    row[7] = uint(subgroup_any((x & 255u) == 7u)) + 2u * uint(subgroup_all((x & 255u) != 7u));
    row[8] = sums.x + 3u * sums.y + 5u * sums.z + 7u * sums.w;
    row[9] = before;
    row[10] = total;
    row[11] = uint(subgroup_width() == push.width) + 2u * uint(subgroup_elect());
    for (uint k = 0u; k < 12u; ++k) results[i * 12u + k] = row[k];
}
