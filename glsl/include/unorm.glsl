// Channels of photographs as numbers from 0 to 1: of every c the float nearest to c / 255 or c / 65535, as the host has it, so that equal
// pictures are equal on every device. unpackUnorm4x8 is a quotient that Vulkan promises within 2.5 ulp, or a product with 1 / 255, which
// is another number for half of all c.
// The inverse in two parts, of which the first times c is exact: the sum is the nearest float whether or not it is one operation with
// either product (for every c).
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
