// The affine colour transforms of photographs: rows of 48 floats in one buffer, each the deviation of a photograph's
// 3x4 matrix from the identity (row-major), its two moments and its last gradient; one more row at the end, whose first
// 12 floats are the mean deviation. A photograph's matrix is the identity plus its deviation minus the mean deviation,
// so the mean over photographs is the identity.
#ifndef EXPOSURE_GLSL
#define EXPOSURE_GLSL

const uint EXPOSURE_NUMBERS = 12u;
const uint EXPOSURE_ROW = 48u;
// Pixels of a workgroup of the passes over pixels: 64 threads with 16 pixels each.
const uint EXPOSURE_PIXELS = 1024u;

#endif
