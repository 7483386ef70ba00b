#version 460
// densify_order: reorders map and identities of the new rows from the order of birth to the sorted order. One thread
// owns one new row; one workgroup owns 64 consecutive rows.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Births { uint births[]; };
layout(set = 0, binding = 2) readonly buffer MapByBirth { uint map_by_birth[]; };
layout(set = 0, binding = 3) readonly buffer IdsByBirth { uint ids_by_birth[]; };
layout(set = 0, binding = 4) writeonly buffer Map { uint map[]; };
layout(set = 0, binding = 5) writeonly buffer Ids { uint ids[]; };
void main() {
    const uint row = global_index();
    if (row >= counters[COUNTER_SCAN_TOTAL]) return;
    const uint birth = births[row];
    map[row] = map_by_birth[birth];
    ids[row] = ids_by_birth[birth];
}
