// Shared by the passes of the gradient-map loss. With a and b the magnitudes of Sobel's gradients of luma, sqrt(gx^2 +
// gy^2 + 1e-6), of render and photograph, r their correlation in a window of 32x32 pixels and e = render - photograph,
// the loss is
//     weight * (1 - sum m r / sum m) + tv_weight * mean sqrt((e right - e)^2 + (e below - e)^2 + 1e-6),
// where m is the sum of the mask over the included pixels of the window (1 each without a mask). Border pixels and
// masked pixels of the photograph are excluded. At masked pixels of the photograph the render counts as equal and has
// no gradient, and differences across a mask's edge are 0. With OTHER, b is of another render of the view, whose masked
// pixels count as equal too: the correlation is then the same with both renders exchanged.
#ifndef GRADIENT_MAP_GLSL
#define GRADIENT_MAP_GLSL

layout(push_constant) uniform Push {
    uint width;
    uint height;
    uint mask_width;
    uint mask_height;
    float weight;
    float tv_weight;
    float values;  // channels times pixels that are not masked
} push;

const uint WINDOW_SIDE = 32u;
// Added under the roots of squared gradients and of squared differences of the residual.
const float ROOT_FLOOR = 1e-6;
// Floor for the lengths of centred windows.
const float LENGTH_FLOOR = 1e-4;

#endif
