// Camera parameters of the projection.
#ifndef CAMERA_GLSL
#define CAMERA_GLSL

const uint VIEW_ANTIALIAS = 1u;        // multiply the opacity by sqrt(det before / det after dilation)
const uint VIEW_REFERENCE_CLAMP = 2u;  // keep the 3DGS reference's derivative of the field-of-view clamp
const uint VIEW_BLACK_LEARNS = 8u;     // a colour at its lower bound has a gradient that raises the colour

struct Camera {
    vec3 w0, w1, w2;  // rows of the rotation
    vec3 t;
    vec3 center;
    float near;
    vec2 focal;
    vec2 principal;
    vec4 limits;
};

#endif
