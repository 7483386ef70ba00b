#version 460
// densify_codes: writes the position of each new row along Morton's curve (Morton 1966), by the mean of the source. One
// thread owns one new row, counted in the order of birth; one workgroup owns 64 consecutive rows. Its entry of `map`
// names the source by rank in the order of birth before, and by row after. A code has ten bits per axis: a sign, and 9
// bits of |x| in cells that double in size at 1, 3 and 7 times 1 / scale, up to 15 times; points beyond are in the
// outermost cells. Cells come from the bits of a float, so cells are equal on every device.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "densify.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer RowOf { uint row_of[]; };
layout(set = 0, binding = 2) readonly buffer Means { float means[]; };
layout(set = 0, binding = 3) buffer Map { uint map[]; };
layout(set = 0, binding = 4) writeonly buffer Codes { uint codes[]; };
layout(set = 0, binding = 5) writeonly buffer Births { uint births[]; };
layout(push_constant) uniform Push { float scale; } push;

uint cell(float x) {
    // From 1 to 16: two bits of the exponent and seven of the mantissa.
    precise float size = min(abs(x) * push.scale, 15.0) + 1.0;
    const uint q = min((floatBitsToUint(size) - 0x3f800000u) >> 16u, 511u);
    return x < 0.0 ? 511u - q : 512u + q;
}

// Bit i to bit 3 i, of ten bits.
uint spread(uint v) {
    v = (v | v << 16u) & 0x030000ffu;
    v = (v | v << 8u) & 0x0300f00fu;
    v = (v | v << 4u) & 0x030c30c3u;
    return (v | v << 2u) & 0x09249249u;
}

void main() {
    const uint birth = global_index();
    if (birth >= counters[COUNTER_SCAN_TOTAL]) return;
    const uint entry = map[birth];
    const uint row = row_of[map_source(entry)];
    map[birth] = map_entry(row, map_kind(entry));
    codes[birth] = spread(cell(means[3u * row])) | spread(cell(means[3u * row + 1u])) << 1u
        | spread(cell(means[3u * row + 2u])) << 2u;
    births[birth] = birth;
}
