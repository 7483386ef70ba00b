// Integer division through floats: a CPU device divides vectors of floats, but integers lane by lane.
#ifndef DIVIDE_GLSL
#define DIVIDE_GLSL

// n / d for quotients below 2^22: the float quotient is off by less than one, and the remainder corrects it.
uint quotient(uint n, uint d) {
    uint q = uint(float(n) / float(d));
    if (q * d > n) q -= 1u;
    if (n - q * d >= d) q += 1u;
    return q;
}

#endif
