#version 460
// loss_rows: the window along rows of (x, x - y, (x - y)^2, x^2 + y^2), x and y about the pivot where they are not differences.
// One thread owns a run of 64 pixels of a row; a workgroup of 8 threads owns the runs of 8 consecutive rows.
#extension GL_GOOGLE_include_directive : require
layout(local_size_x = 8) in;
#include "loss.glsl"
layout(set = 0, binding = 0) readonly buffer Image { float image[]; };
layout(set = 0, binding = 1) readonly buffer Target { uint target[]; };
layout(set = 0, binding = 2) writeonly buffer Planes { vec4 planes[]; };

void main() {
    const uint row = global_index() % push.height;
    const uint run = global_index() / push.height;
    if (run >= runs()) return;
    const uint first = run * RUN;
    const uint end = min(first + RUN, push.width);
    const uint base = row * push.width;
    Window window = window_empty();
    for (uint i = first; i < end + 2u * WINDOW_RADIUS; ++i) {
        const uint column = i - WINDOW_RADIUS;
        float x = 0.0;
        float y = 0.0;
        if (column < push.width) {
            x = image[4u * (base + column) + push.channel];
            y = photograph(target[base + column]);
        }
        const float d = x - y;
        const vec2 p = vec2(x, y) - PIVOT;
        const vec4 moments = window_take(window, vec4(p.x, d, d * d, dot(p, p)));
        if (i >= first + 2u * WINDOW_RADIUS) planes[base + column - WINDOW_RADIUS] = moments;
    }
}
