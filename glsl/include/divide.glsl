// Division of whole numbers by way of floats: a processor divides vectors of floats, but whole numbers one by one.
#ifndef DIVIDE_GLSL
#define DIVIDE_GLSL

// n / d for quotients below 2^22: the rounded quotient is off by less than one, which the remainder shows.
uint quotient(uint n, uint d) {
    uint q = uint(float(n) / float(d));
    if (q * d > n) q -= 1u;
    if (n - q * d >= d) q += 1u;
    return q;
}

#endif
