// Number of elements of a pass: from a counter or from the host, optionally reshaped into rows of a table. Number of
// its workgroups.
#ifndef COUNT_GLSL
#define COUNT_GLSL

const uint NO_COUNTER = 0xffffffffu;

// Elements in a table of `multiply` rows with one column per `divide` elements. Divide and multiply by 1 for the plain
// count.
uint table_size(uint count, uint divide, uint multiply) {
    return (count / divide + uint(count % divide != 0u)) * multiply;
}

// Most workgroups on one axis; devices allow at least 65,535.
const uint MOST_ON_AXIS = 32768u;

// Entry of `args` for a number of workgroups: spread over two axes.
uvec4 entry_of(uint groups) {
    if (groups == 0u) return uvec4(0u);
    const uint rows = table_size(groups, MOST_ON_AXIS, 1u);
    return uvec4(table_size(groups, rows, 1u), rows, 1u, 0u);
}

#endif
