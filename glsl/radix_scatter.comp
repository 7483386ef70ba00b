#version 460
//! variant runs
//! variant groups RADIX_GROUPS
//! variant groups_emulated RADIX_GROUPS SUBGROUP_EMULATED
// radix_scatter: moves keys and values to their places by one digit, keeping the order of equal digits. `places` is the
// prefix sum of radix_count's table (runs), or the output of radix_rows (groups). Digits up to 256. runs (CPU devices):
// one thread owns a block of BLOCK keys and walks it with private places; a workgroup owns 8 blocks. groups: a
// workgroup owns a block of 256 * ITEMS keys, a subgroup ITEMS consecutive rows with one key per lane, a thread one
// column. One vote per bit finds the lanes with the same digit; the first of these lanes adds their number to the
// subgroup's counter of the digit. Prefix sums of the counters over subgroups and digits rank the keys; the block is
// put in order in shared memory, first its keys and then its values, so that neighbours write to neighbouring places.
// (Warp-level multi-split: Ashkiani et al. 2016; reduce-then-scan, so that no workgroup waits for another.)
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#ifdef RADIX_GROUPS
#define LOCAL_SIZE 256
#include "subgroup.glsl"
#include "workgroup_sum.glsl"
#else
#define LOCAL_SIZE 8
#endif
#include "common.glsl"
#include "count.glsl"
layout(local_size_x = LOCAL_SIZE) in;
const uint MOST_DIGITS = 256u;
#ifdef RADIX_GROUPS
layout(constant_id = 0) const uint ITEMS = 8u;
#ifdef SUBGROUP_EMULATED
#define WIDTH EMULATED_WIDTH
#else
layout(constant_id = 1) const uint WIDTH = 32u;  // of subgroups
#endif
// 16-bit counters [subgroup][digit], where a subgroup of the first half and one of the second half share a word; later
// the block in sorted order.
const uint HALF = LOCAL_SIZE / WIDTH / 2u;
const uint COUNTED = MOST_DIGITS * HALF;
const uint STAGED = LOCAL_SIZE * ITEMS;
shared uint words[COUNTED > STAGED ? COUNTED : STAGED];
shared uint digit_places[MOST_DIGITS];
#else
layout(constant_id = 0) const uint BLOCK = 1024u;
#endif
layout(set = 0, binding = 0) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 1) readonly buffer Vals { uint vals[]; };
layout(set = 0, binding = 2) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 3) readonly buffer Places { uint places[]; };
layout(set = 0, binding = 4) writeonly buffer KeysOut { uint keys_out[]; };
layout(set = 0, binding = 5) writeonly buffer ValsOut { uint vals_out[]; };
layout(push_constant) uniform Push {
    uint source;  // counter that holds the number of keys, or NO_COUNTER
    uint count;   // the number of keys for NO_COUNTER
    uint shift;   // digit = (key >> shift) & mask
    uint mask;
    uint digits;  // rows of the table, more than mask
} push;
#ifdef RADIX_GROUPS
// Of the lanes in `votes`: their number, the number before this lane, and the first lane.
uint votes_in(uvec4 votes) { return WIDTH <= 32u ? uint(bitCount(votes.x)) : ballot_count(votes); }
uint votes_before(uvec4 votes) {
    return WIDTH <= 32u ? uint(bitCount(votes.x & ((1u << subgroup_lane()) - 1u))) : ballot_before(votes);
}
uint first_vote(uvec4 votes) {
    return votes.x != 0u ? uint(findLSB(votes.x)) : votes.y != 0u ? 32u + uint(findLSB(votes.y)) :
        votes.z != 0u ? 64u + uint(findLSB(votes.z)) : 96u + uint(findLSB(votes.w));
}
#endif

void main() {
    const uint n = push.source == NO_COUNTER ? push.count : counters[push.source];
#ifdef RADIX_GROUPS
    const uint block = group_index();
    const uint blocks = table_size(n, LOCAL_SIZE * ITEMS, 1u);
    const uint begin = block * LOCAL_SIZE * ITEMS;
    const uint valid = block < blocks ? min(n - begin, LOCAL_SIZE * ITEMS) : 0u;
    const uint own = subgroup_number();
    const uint own_row = own % HALF * MOST_DIGITS;
    const uint own_shift = own / HALF * 16u;
    const uint lane = subgroup_lane();
    const uint first = own * WIDTH * ITEMS + lane;
    for (uint i = local_index(); i < COUNTED; i += LOCAL_SIZE) words[i] = 0u;
    uint own_key[ITEMS];
    uint own_val[ITEMS];
    uint own_place[ITEMS];
    for (uint i = 0u; i < ITEMS; ++i) {
        const uint at = first + i * WIDTH;
        // Elements past the end get the highest digit and come last, so after every key.
        own_key[i] = 0xffffffffu;
        own_val[i] = 0u;
        if (at < valid) {
            own_key[i] = keys[begin + at];
            own_val[i] = vals[begin + at];
        }
    }
    const uvec4 all = subgroup_ballot(true);
    barrier();
    for (uint i = 0u; i < ITEMS; ++i) {
        const uint digit = (own_key[i] >> push.shift) & push.mask;
        uvec4 same = all;
        [[unroll]] for (uint bit = 0u; bit < 8u; ++bit) {
            if ((push.mask >> bit & 1u) == 0u) break;
            const bool set = (digit >> bit & 1u) != 0u;
            const uvec4 votes = subgroup_ballot(set);
            same &= set ? votes : ~votes;
        }
        const uint before = votes_before(same);
        uint counted = 0u;
        if (before == 0u) counted = atomicAdd(words[own_row + digit], votes_in(same) << own_shift);
        own_place[i] = before + (subgroup_shuffle(counted, first_vote(same)) >> own_shift & 0xffffu);
        subgroup_meet();
    }
    barrier();
    // One thread per digit, in the order of the workgroup's sums.
    const uint digit_of_thread = workgroup_rank();
    uvec2 sums = uvec2(0u);
    for (uint s = 0u; s < HALF; ++s) {
        const uint counted = words[s * MOST_DIGITS + digit_of_thread];
        sums += uvec2(counted & 0xffffu, counted >> 16);
    }
    uint total;
    const uint start = workgroup_exclusive_add(sums.x + sums.y, total);
    uvec2 running = uvec2(start, start + sums.x);
    for (uint s = 0u; s < HALF; ++s) {
        const uint counted = words[s * MOST_DIGITS + digit_of_thread];
        words[s * MOST_DIGITS + digit_of_thread] = running.x | running.y << 16;
        running += uvec2(counted & 0xffffu, counted >> 16);
    }
    const bool used = block < blocks && digit_of_thread < push.digits;
    const uint of_digit = used ? places[push.digits * blocks + digit_of_thread] : 0u;
    const uint in_row = used ? places[digit_of_thread * blocks + block] : 0u;
    // Modulo 2^32: adding a key's position in the block gives the key's place.
    digit_places[digit_of_thread] = workgroup_exclusive_add(of_digit, total) + in_row - start;
    barrier();
    for (uint i = 0u; i < ITEMS; ++i) {
        own_place[i] += words[own_row + ((own_key[i] >> push.shift) & push.mask)] >> own_shift & 0xffffu;
    }
    barrier();
    for (uint i = 0u; i < ITEMS; ++i) {
        if (first + i * WIDTH < valid) words[own_place[i]] = own_key[i];
    }
    barrier();
    uint to[ITEMS];
    for (uint i = 0u; i < ITEMS; ++i) {
        const uint at = i * LOCAL_SIZE + local_index();
        to[i] = 0u;
        if (at < valid) {
            const uint key = words[at];
            to[i] = digit_places[(key >> push.shift) & push.mask] + at;
            keys_out[to[i]] = key;
        }
    }
    barrier();
    for (uint i = 0u; i < ITEMS; ++i) {
        if (first + i * WIDTH < valid) words[own_place[i]] = own_val[i];
    }
    barrier();
    for (uint i = 0u; i < ITEMS; ++i) {
        const uint at = i * LOCAL_SIZE + local_index();
        if (at < valid) vals_out[to[i]] = words[at];
    }
#else
    const uint block = global_index();
    const uint blocks = table_size(n, BLOCK, 1u);
    if (block >= blocks) return;
    const uint digits = min(push.digits, MOST_DIGITS);
    uint place[MOST_DIGITS];
    for (uint digit = 0u; digit < digits; ++digit) place[digit] = places[digit * blocks + block];
    const uint end = min((block + 1u) * BLOCK, n);
    for (uint i = block * BLOCK; i < end; ++i) {
        const uint key = keys[i];
        const uint digit = (key >> push.shift) & push.mask;
        const uint to = place[digit];
        place[digit] = to + 1u;
        keys_out[to] = key;
        vals_out[to] = vals[i];
    }
#endif
}
