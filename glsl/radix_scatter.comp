#version 460
//! variant runs
//! variant groups RADIX_GROUPS
//! variant groups_emulated RADIX_GROUPS SUBGROUP_EMULATED
// radix_scatter: moves keys and values to their places by one digit, keeping the order of equal digits. `places` is the prefix sum
// of radix_count's table.
// runs (CPU devices): one thread owns a block of BLOCK keys and walks it with private places; a workgroup owns 8 blocks.
// groups: a workgroup owns a block of 128 * ITEMS keys, a thread ITEMS consecutive ones. Each thread counts its digits in its own
// column of 16-bit counters (digits d and d + 8 share a word), whose prefix sum over (digit, thread) ranks the keys (Merrill and
// Grimshaw's ranking); the block is put in order in shared memory so that neighbours write to neighbouring places.
#extension GL_GOOGLE_include_directive : require
#ifdef RADIX_GROUPS
#define LOCAL_SIZE 128
#include "subgroup.glsl"
#include "workgroup_sum.glsl"
#else
#define LOCAL_SIZE 8
#endif
#include "common.glsl"
#include "count.glsl"
layout(local_size_x = LOCAL_SIZE) in;
#ifdef RADIX_GROUPS
layout(constant_id = 0) const uint ITEMS = 8u;
const uint LANES = 8u;  // words of counters per thread
shared uint ranks[LANES * LOCAL_SIZE];
shared uint block_keys[LOCAL_SIZE * ITEMS];
shared uint block_vals[LOCAL_SIZE * ITEMS];
#else
layout(constant_id = 0) const uint BLOCK = 1024u;
const uint MOST_DIGITS = 256u;
#endif
layout(set = 0, binding = 0) readonly buffer Keys { uint keys[]; };
layout(set = 0, binding = 1) readonly buffer Vals { uint vals[]; };
layout(set = 0, binding = 2) readonly buffer Counters { uint counters[]; };
layout(set = 0, binding = 3) readonly buffer Places { uint places[]; };
layout(set = 0, binding = 4) writeonly buffer KeysOut { uint keys_out[]; };
layout(set = 0, binding = 5) writeonly buffer ValsOut { uint vals_out[]; };
layout(push_constant) uniform Push {
    uint source;  // counter that holds the number of keys, or NO_COUNTER
    uint count;   // the number when there is no counter
    uint shift;   // digit = (key >> shift) & mask
    uint mask;
    uint digits;  // rows of the table, more than mask
} push;
void main() {
    const uint n = push.source == NO_COUNTER ? push.count : counters[push.source];
#ifdef RADIX_GROUPS
    const uint block = group_index();
    const uint blocks = table_size(n, LOCAL_SIZE * ITEMS, 1u);
    const uint begin = block * LOCAL_SIZE * ITEMS;
    const uint valid = block < blocks ? min(n - begin, LOCAL_SIZE * ITEMS) : 0u;
    // Counters lie in the order of the workgroup's sums, so a thread's place among the keys is its rank, not its local index.
    const uint rank = workgroup_rank();
    for (uint lane = 0u; lane < LANES; ++lane) ranks[lane * LOCAL_SIZE + rank] = 0u;
    uint own_key[ITEMS];
    uint own_place[ITEMS];
    for (uint i = 0u; i < ITEMS; ++i) {
        const uint at = rank * ITEMS + i;
        // What lies past the end ranks behind every key: it has the highest digit and comes last.
        own_key[i] = 0xffffffffu;
        uint digit = 15u;
        if (at < valid) {
            own_key[i] = keys[begin + at];
            digit = (own_key[i] >> push.shift) & push.mask;
        }
        const uint word = (digit & 7u) * LOCAL_SIZE + rank;
        const uint half_shift = (digit >> 3) * 16u;
        const uint before = ranks[word];
        own_place[i] = (before >> half_shift) & 0xffffu;
        ranks[word] = before + (1u << half_shift);
    }
    barrier();
    uint sum = 0u;
    for (uint i = 0u; i < LANES; ++i) sum += ranks[rank * LANES + i];
    uint total;
    uint running = workgroup_exclusive_add(sum, total);
    // The high halves (digits 8 to 15) begin after all of the low ones.
    running += total << 16;
    for (uint i = 0u; i < LANES; ++i) {
        const uint word = ranks[rank * LANES + i];
        ranks[rank * LANES + i] = running;
        running += word;
    }
    barrier();
    for (uint i = 0u; i < ITEMS; ++i) {
        const uint at = rank * ITEMS + i;
        if (at < valid) {
            const uint digit = (own_key[i] >> push.shift) & push.mask;
            const uint place = own_place[i] + ((ranks[(digit & 7u) * LOCAL_SIZE + rank] >> ((digit >> 3) * 16u)) & 0xffffu);
            block_keys[place] = own_key[i];
            block_vals[place] = vals[begin + at];
        }
    }
    barrier();
    for (uint i = 0u; i < ITEMS; ++i) {
        const uint at = i * LOCAL_SIZE + local_index();
        if (at < valid) {
            const uint key = block_keys[at];
            const uint digit = (key >> push.shift) & push.mask;
            const uint start = (ranks[(digit & 7u) * LOCAL_SIZE] >> ((digit >> 3) * 16u)) & 0xffffu;
            const uint to = places[digit * blocks + block] + (at - start);
            keys_out[to] = key;
            vals_out[to] = block_vals[at];
        }
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
