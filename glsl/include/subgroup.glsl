// Subgroup operations with two bodies: the hardware's, and an emulation in shared memory (SUBGROUP_EMULATED) whose
// width is a specialization constant, so that widths of 32 and 64 can be tested on a device of width 8, and devices
// without the extension run.
//
// Before including, and before any declaration: `#define LOCAL_SIZE n`, the threads of the workgroup, a multiple of the
// width. Every function must be reached by all threads of the workgroup (the emulation has barriers in it). Code must
// not depend on the width, and must not take local_index() / width for the subgroup's number: use subgroup_number() and
// workgroup_rank(). Subgroups are full: the device layer requires full subgroups, and a workgroup is a multiple of the
// width.
#ifndef SUBGROUP_GLSL
#define SUBGROUP_GLSL

#ifndef SUBGROUP_EMULATED

#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_arithmetic : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require
#extension GL_KHR_shader_subgroup_vote : require

uint subgroup_width() { return gl_SubgroupSize; }
uint subgroup_lane() { return gl_SubgroupInvocationID; }
uint subgroup_number() { return gl_SubgroupID; }
uint subgroup_count() { return gl_NumSubgroups; }

uint subgroup_add(uint x) { return subgroupAdd(x); }
float subgroup_add(float x) { return subgroupAdd(x); }
vec2 subgroup_add(vec2 x) { return subgroupAdd(x); }
vec3 subgroup_add(vec3 x) { return subgroupAdd(x); }
vec4 subgroup_add(vec4 x) { return subgroupAdd(x); }
uint subgroup_exclusive_add(uint x) { return subgroupExclusiveAdd(x); }
uint subgroup_max(uint x) { return subgroupMax(x); }
uint subgroup_shuffle(uint x, uint lane) { return subgroupShuffle(x, lane); }
float subgroup_shuffle(float x, uint lane) { return subgroupShuffle(x, lane); }
bool subgroup_any(bool x) { return subgroupAny(x); }
bool subgroup_all(bool x) { return subgroupAll(x); }
uvec4 subgroup_ballot(bool x) { return subgroupBallot(x); }
float subgroup_shuffle_xor(float x, uint bit) { return subgroupShuffleXor(x, bit); }
// Makes earlier writes of a lane to shared memory visible to the other lanes of the subgroup.
void subgroup_meet() { subgroupBarrier(); }

#else

#ifndef EMULATED_WIDTH_DEFAULT
#define EMULATED_WIDTH_DEFAULT 32u
#endif
layout(constant_id = 100) const uint EMULATED_WIDTH = EMULATED_WIDTH_DEFAULT;
shared uint subgroup_words[LOCAL_SIZE];

uint subgroup_width() { return EMULATED_WIDTH; }
uint subgroup_lane() { return gl_LocalInvocationID.x % EMULATED_WIDTH; }
uint subgroup_number() { return gl_LocalInvocationID.x / EMULATED_WIDTH; }
uint subgroup_count() { return LOCAL_SIZE / EMULATED_WIDTH; }

// Stores every lane's word in shared memory; returns the index of this subgroup's first word. Ends with a barrier.
uint subgroup_publish(uint x) {
    subgroup_words[gl_LocalInvocationID.x] = x;
    barrier();
    return subgroup_number() * EMULATED_WIDTH;
}

uint subgroup_add(uint x) {
    const uint base = subgroup_publish(x);
    uint sum = 0u;
    for (uint i = 0u; i < EMULATED_WIDTH; ++i) sum += subgroup_words[base + i];
    barrier();
    return sum;
}

float subgroup_add(float x) {
    const uint base = subgroup_publish(floatBitsToUint(x));
    float sum = 0.0;
    for (uint i = 0u; i < EMULATED_WIDTH; ++i) sum += uintBitsToFloat(subgroup_words[base + i]);
    barrier();
    return sum;
}

vec2 subgroup_add(vec2 x) { return vec2(subgroup_add(x.x), subgroup_add(x.y)); }
vec3 subgroup_add(vec3 x) { return vec3(subgroup_add(x.xy), subgroup_add(x.z)); }
vec4 subgroup_add(vec4 x) { return vec4(subgroup_add(x.xy), subgroup_add(x.zw)); }

uint subgroup_exclusive_add(uint x) {
    const uint base = subgroup_publish(x);
    const uint lane = subgroup_lane();
    uint sum = 0u;
    for (uint i = 0u; i < lane; ++i) sum += subgroup_words[base + i];
    barrier();
    return sum;
}

uint subgroup_max(uint x) {
    const uint base = subgroup_publish(x);
    uint most = 0u;
    for (uint i = 0u; i < EMULATED_WIDTH; ++i) most = max(most, subgroup_words[base + i]);
    barrier();
    return most;
}

uint subgroup_shuffle(uint x, uint lane) {
    const uint base = subgroup_publish(x);
    const uint word = subgroup_words[base + lane % EMULATED_WIDTH];
    barrier();
    return word;
}

float subgroup_shuffle(float x, uint lane) { return uintBitsToFloat(subgroup_shuffle(floatBitsToUint(x), lane)); }

uvec4 subgroup_ballot(bool x) {
    const uint base = subgroup_publish(uint(x));
    uvec4 bits = uvec4(0u);
    for (uint i = 0u; i < EMULATED_WIDTH; ++i) {
        if (i < 32u) bits.x |= subgroup_words[base + i] << i;
        else bits.y |= subgroup_words[base + i] << (i - 32u);
    }
    barrier();
    return bits;
}

float subgroup_shuffle_xor(float x, uint bit) { return subgroup_shuffle(x, subgroup_lane() ^ bit); }
void subgroup_meet() { barrier(); }

bool subgroup_any(bool x) { return subgroup_ballot(x).xy != uvec2(0u); }
bool subgroup_all(bool x) { return subgroup_ballot(!x).xy == uvec2(0u); }

#endif

// True in one lane of each subgroup.
bool subgroup_elect() { return subgroup_lane() == 0u; }

// The value of one lane, whose number is uniform in the subgroup.
uint subgroup_broadcast(uint x, uint lane) { return subgroup_shuffle(x, lane); }
float subgroup_broadcast(float x, uint lane) { return subgroup_shuffle(x, lane); }

// Votes of the lanes before this one in a ballot, and of all lanes.
uint ballot_before(uvec4 ballot) {
    const uint lane = subgroup_lane();
    uint count = 0u;
    for (uint word = 0u; word < 4u; ++word) {
        const uint first = word * 32u;
        const uint mask = lane >= first + 32u ? 0xffffffffu : (lane > first ? (1u << (lane - first)) - 1u : 0u);
        count += uint(bitCount(ballot[word] & mask));
    }
    return count;
}
uint ballot_count(uvec4 ballot) {
    return uint(bitCount(ballot.x) + bitCount(ballot.y) + bitCount(ballot.z) + bitCount(ballot.w));
}

// This thread's rank in the order (subgroup, lane), the order of workgroup sums. Not always local_index().
uint workgroup_rank() { return subgroup_number() * subgroup_width() + subgroup_lane(); }

#endif
