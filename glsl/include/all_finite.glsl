// Whether every parameter of a splat is a finite number. To be included after finite.glsl, counters.glsl and the
// bindings of the model's planes.
#ifndef ALL_FINITE_GLSL
#define ALL_FINITE_GLSL

bool all_finite(uint i) {
    bool ok = finite(opacities[i]);
    for (uint k = 0u; k < 3u; ++k) ok = ok && finite(means[3u * i + k]) && finite(scales[3u * i + k]);
    for (uint k = 0u; k < 4u; ++k) ok = ok && finite(quats[4u * i + k]);
    for (uint k = 0u; k < 12u; ++k) ok = ok && finite(sh0[12u * i + k]);
    if (i >= FULL_ROWS) return ok;
    for (uint k = 0u; k < 12u; ++k) {
        const uint e = 12u * i + k;
        ok = ok && finite(sh1[e]) && finite(sh2[e]) && finite(sh3[e]);
    }
    return ok;
}

#endif
