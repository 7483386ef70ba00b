// SSIM's window along one axis: 11 taps of a Gaussian with sigma 1.5, as a filter that takes values one by one.
#ifndef WINDOW_GLSL
#define WINDOW_GLSL

#extension GL_EXT_control_flow_attributes : require

const uint WINDOW_RADIUS = 5u;
const float WINDOW[6] = float[6](0.00102838008, 0.00759875814, 0.0360007721, 0.109360690, 0.213005538, 0.266011725);

// The ten sums under way. pending[j] belongs to the value that came j - 5 after the last one.
struct Window {
    vec4 pending[10];
};

Window window_empty() {
    Window w;
    [[unroll]] for (uint j = 0u; j < 10u; ++j) w.pending[j] = vec4(0.0);
    return w;
}

// Takes a value; returns the weighted sum around the value that came five before it.
vec4 window_take(inout Window w, vec4 x) {
    vec4 term[6];
    [[unroll]] for (uint j = 0u; j < 6u; ++j) term[j] = WINDOW[j] * x;
    const vec4 done = w.pending[0] + term[0];
    [[unroll]] for (uint j = 0u; j < 9u; ++j) w.pending[j] = w.pending[j + 1u] + term[j < 5u ? j + 1u : 9u - j];
    w.pending[9] = term[0];
    return done;
}

#endif
