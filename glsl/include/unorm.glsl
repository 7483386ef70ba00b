// Channels of photographs as numbers from 0 to 1: for every c the float nearest to c / 255 or c / 65535, as on the
// host, so that equal images are equal on every device. unpackUnorm4x8 is a quotient, which Vulkan promises only within
// 2.5 ulp, or a product with 1 / 255, which differs for half of all c. The inverse in two parts. The first part times c
// is exact, so the sum is the nearest float for every c, with or without fused operations.
#ifndef UNORM_GLSL
#define UNORM_GLSL

vec3 unorm8(uint rgb) {
    const vec3 c = vec3(ivec3(rgb & 0xffu, rgb >> 8u & 0xffu, rgb >> 16u & 0xffu));
    precise vec3 of_one = fma(c, vec3(0.00392150879), c * 5.9838392e-08);
    return of_one;
}

vec3 unorm16(uint red_green, uint blue) {
    const vec3 c = vec3(ivec3(red_green & 0xffffu, red_green >> 16u, blue & 0xffffu));
    precise vec3 of_one = fma(c, vec3(1.52587891e-05), c * 2.32834196e-10);
    return of_one;
}

#endif
