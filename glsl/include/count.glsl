// Number of elements of a pass: from a counter or from the host, optionally reshaped into rows of a table.
#ifndef COUNT_GLSL
#define COUNT_GLSL

const uint NO_COUNTER = 0xffffffffu;

// Elements in a table of `multiply` rows with one column per `divide` elements. Divide and multiply by 1 for the plain
// count.
uint table_size(uint count, uint divide, uint multiply) {
    return (count / divide + uint(count % divide != 0u)) * multiply;
}

#endif
