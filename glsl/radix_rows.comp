#version 460
//! variant subgroup
//! variant emulated SUBGROUP_EMULATED
// radix_rows: runs between radix_count and radix_scatter of the groups shape. Per digit, writes the exclusive prefix
// sum over the blocks of keys, and after the table the number of keys with the digit. radix_scatter adds the counts of
// lower digits. So one pass suffices for any number of keys, and no workgroup waits for another. A workgroup owns a
// digit, a row of the table, and walks along it; in each turn a thread owns PER_TURN consecutive words.
#extension GL_GOOGLE_include_directive : require
#define LOCAL_SIZE 256
#include "subgroup.glsl"
#include "workgroup_sum.glsl"
#include "common.glsl"
#include "count.glsl"
layout(local_size_x = LOCAL_SIZE) in;
layout(constant_id = 0) const uint ITEMS = 8u;  // of radix_count: a block has 256 * ITEMS keys
const uint PER_TURN = 4u;
layout(set = 0, binding = 0) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 1) readonly buffer Table { uint table[]; };
layout(set = 0, binding = 2) writeonly buffer Places { uint places[]; };
layout(push_constant) uniform Push {
    uint source;  // counter that holds the number of keys, or NO_COUNTER
    uint count;   // the number of keys for NO_COUNTER
    uint shift;
    uint mask;
    uint digits;  // rows of the table
} push;

void main() {
    const uint n = push.source == NO_COUNTER ? push.count : counters[push.source];
    const uint blocks = table_size(n, LOCAL_SIZE * ITEMS, 1u);
    const uint digit = group_index();
    const bool owner = digit < push.digits;
    const uint begin = digit * blocks;
    const uint end = owner ? begin + blocks : begin;
    uint carry = 0u;
    for (uint turn = begin; turn < end; turn += LOCAL_SIZE * PER_TURN) {
        const uint first = turn + workgroup_rank() * PER_TURN;
        uint own[PER_TURN];
        uint sum = 0u;
        for (uint i = 0u; i < PER_TURN; ++i) {
            own[i] = first + i < end ? table[first + i] : 0u;
            sum += own[i];
        }
        uint total;
        uint running = carry + workgroup_exclusive_add(sum, total);
        for (uint i = 0u; i < PER_TURN; ++i) {
            if (first + i < end) places[first + i] = running;
            running += own[i];
        }
        carry += total;
    }
    if (owner && local_index() == 0u) places[push.digits * blocks + digit] = carry;
}
