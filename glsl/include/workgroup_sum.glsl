// Sums over a workgroup in the order of workgroup_rank(). Include after subgroup.glsl; reached by all threads.
#ifndef WORKGROUP_SUM_GLSL
#define WORKGROUP_SUM_GLSL

// One word per subgroup, for any width of at least 1.
shared uint workgroup_sums[LOCAL_SIZE];

// Sum of `x` over the threads of lower rank; `total` over all.
uint workgroup_exclusive_add(uint x, out uint total) {
    const uint before = subgroup_exclusive_add(x);
    const uint sum = subgroup_add(x);
    if (subgroup_elect()) workgroup_sums[subgroup_number()] = sum;
    barrier();
    uint base = 0u;
    uint all = 0u;
    const uint own = subgroup_number();
    const uint subgroups = subgroup_count();
    for (uint s = 0u; s < subgroups; ++s) {
        if (s == own) base = all;
        all += workgroup_sums[s];
    }
    barrier();
    total = all;
    return base + before;
}

#endif
