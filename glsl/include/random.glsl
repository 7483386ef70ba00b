// Counter-based random numbers: a draw is a function of its key only, so a draw does not depend on the order of threads
// or the row of a splat. Integers agree with src/twin/random.rs in every bit, and so do the normals wherever the device
// rounds sqrt correctly: ln, sin, cos and exp are polynomials here because Vulkan promises only 2^-11 for sin.
#ifndef RANDOM_GLSL
#define RANDOM_GLSL

// PCG-4D of Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 2020.
uvec4 random_bits(uvec4 key) {
    uvec4 v = key * 1664525u + 1013904223u;
    v.x += v.y * v.w; v.y += v.z * v.x; v.z += v.x * v.y; v.w += v.y * v.z;
    v ^= v >> 16u;
    v.x += v.y * v.w; v.y += v.z * v.x; v.z += v.x * v.y; v.w += v.y * v.z;
    return v;
}

// ln x for normal x > 0; relative error below 1e-7 near 1, where the Box-Muller radius needs it.
float random_ln(float x) {
    const uint bits = floatBitsToUint(x);
    // Exponent and mantissa in [sqrt(1/2), sqrt(2)): 0x3f3504f3 is sqrt(1/2).
    const uint shifted = bits - 0x3f3504f3u;
    const int exponent = int(shifted) >> 23;
    precise float f = uintBitsToFloat((shifted & 0x007fffffu) + 0x3f3504f3u) - 1.0;
    precise float p = 0.0714975372;
    p = p * f + -0.115712009;
    p = p * f + 0.116615109;
    p = p * f + -0.124110505;
    p = p * f + 0.142499372;
    p = p * f + -0.166684806;
    p = p * f + 0.200007081;
    p = p * f + -0.249999896;
    p = p * f + 0.333333313;
    precise float square = f * f;
    precise float near_one = f + ((square * f) * p - 0.5 * square);
    precise float result = float(exponent) * 0.69314718 + near_one;
    return result;
}

// exp x for |x| < 87, relative error below 3e-7; beyond that the result stays finite or becomes 0.
float random_exp(float x) {
    precise float k = floor(clamp(x, -87.0, 88.0) * 1.44269504 + 0.5);
    precise float r = (clamp(x, -87.0, 88.0) - k * 0.693359375) - k * -0.000212194440;
    precise float p = 0.00019899277;
    p = p * r + 0.00139336439;
    p = p * r + 0.00833329838;
    p = p * r + 0.0416664667;
    p = p * r + 0.166666672;
    p = p * r + 0.5;
    precise float fraction = 1.0 + (r + (r * r) * p);
    precise float result = fraction * uintBitsToFloat(uint(int(k) + 127) << 23u);
    return result;
}

// (cos, sin) of 2 pi bits / 2^24.
vec2 random_direction(uint bits) {
    // Nearest quarter turn and the rest in [-1/2, 1/2) of a quarter: exact, since everything has 24 bits.
    const uint quarter = (bits + (1u << 21u)) >> 22u;
    precise float f = float(int(bits) - int(quarter << 22u)) * (1.0 / 4194304.0);
    precise float z = f * f;
    precise float s = 0.000158206502;
    s = s * z + -0.00468126638;
    s = s * z + 0.0796925798;
    s = s * z + -0.645964086;
    s = s * z + 1.57079637;
    s = s * f;
    precise float c = 0.000903629872;
    c = c * z + -0.0208600704;
    c = c * z + 0.253669202;
    c = c * z + -1.23370051;
    c = c * z + 1.0;
    switch (quarter & 3u) {
        case 0u: return vec2(c, s);
        case 1u: return vec2(-s, c);
        case 2u: return vec2(-c, -s);
        default: return vec2(s, -c);
    }
}

// Two independent standard normals by Box and Muller, from the upper 24 bits of each word; the radius is at most 5.8.
vec2 random_normal_pair(uint a, uint b) {
    precise float uniform_a = float((a >> 8u) + 1u) * (1.0 / 16777216.0);
    precise float radius = sqrt(max(-2.0 * random_ln(uniform_a), 0.0));
    precise vec2 pair = radius * random_direction(b >> 8u);
    return pair;
}

// Three independent standard normals.
vec3 random_normals(uvec4 key) {
    const uvec4 bits = random_bits(key);
    return vec3(random_normal_pair(bits.x, bits.y), random_normal_pair(bits.z, bits.w).x);
}

#endif
