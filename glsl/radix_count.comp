#version 460
//! variant runs
//! variant groups RADIX_GROUPS
// radix_count: counts each digit in each block of consecutive keys, as a table [digit][block]. The prefix sum of the
// table gives the places of each block's keys in a stable sort by the digit. Digits up to 256. runs (CPU devices): one
// thread owns a block and counts in private memory; a workgroup owns 8 blocks. groups: a workgroup owns a block of 256
// * ITEMS keys, a thread every 256th of them, and counts in shared memory.
#extension GL_GOOGLE_include_directive : require
#ifdef RADIX_GROUPS
#define LOCAL_SIZE 256
#else
#define LOCAL_SIZE 8
#endif
#include "common.glsl"
#include "count.glsl"
layout(local_size_x = LOCAL_SIZE) in;
const uint MOST_DIGITS = 256u;
#ifdef RADIX_GROUPS
layout(constant_id = 0) const uint ITEMS = 8u;
shared uint histogram[MOST_DIGITS];
#else
layout(constant_id = 0) const uint BLOCK = 1024u;
#endif
layout(set = 0, binding = 0) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 1) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 2) writeonly buffer Table { uint table[]; };
layout(push_constant) uniform Push {
    uint source;  // counter that holds the number of keys, or NO_COUNTER
    uint count;   // the number of keys for NO_COUNTER
    uint shift;   // digit = (key >> shift) & mask
    uint mask;
    uint digits;  // rows of the table, more than mask
} push;
void main() {
    const uint n = push.source == NO_COUNTER ? push.count : counters[push.source];
    const uint digits = min(push.digits, MOST_DIGITS);
#ifdef RADIX_GROUPS
    const uint block = group_index();
    const uint blocks = table_size(n, LOCAL_SIZE * ITEMS, 1u);
    const uint begin = block * LOCAL_SIZE * ITEMS;
    const uint valid = block < blocks ? min(n - begin, LOCAL_SIZE * ITEMS) : 0u;
    histogram[local_index()] = 0u;
    barrier();
    for (uint i = 0u; i < ITEMS; ++i) {
        const uint at = i * LOCAL_SIZE + local_index();
        if (at < valid) atomicAdd(histogram[(keys[begin + at] >> push.shift) & push.mask], 1u);
    }
    barrier();
    if (block < blocks && local_index() < digits) table[local_index() * blocks + block] = histogram[local_index()];
#else
    const uint block = global_index();
    const uint blocks = table_size(n, BLOCK, 1u);
    if (block >= blocks) return;
    uint histogram[MOST_DIGITS];
    for (uint digit = 0u; digit < digits; ++digit) histogram[digit] = 0u;
    const uint end = min((block + 1u) * BLOCK, n);
    for (uint i = block * BLOCK; i < end; ++i) histogram[(keys[i] >> push.shift) & push.mask] += 1u;
    for (uint digit = 0u; digit < digits; ++digit) table[digit * blocks + block] = histogram[digit];
#endif
}
