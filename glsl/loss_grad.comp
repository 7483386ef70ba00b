#version 460
// loss_grad: the window along rows of SSIM's derivatives, the gradient of the loss with respect to the render, and sums of |x - y|.
// One thread owns a run of 64 pixels of a row; a workgroup of 8 threads owns the runs of 8 consecutive rows.
#extension GL_GOOGLE_include_directive : require
layout(local_size_x = 8) in;
#include "loss.glsl"
layout(set = 0, binding = 0) readonly buffer Image { float image[]; };
layout(set = 0, binding = 1) readonly buffer Target { uint target[]; };
layout(set = 0, binding = 2) readonly buffer Planes { vec4 planes[]; };
layout(set = 0, binding = 3) writeonly buffer GradImage { float grad_image[]; };
layout(set = 0, binding = 4) writeonly buffer L1Parts { float l1_parts[]; };

void main() {
    const uint row = global_index() % push.height;
    const uint run = global_index() / push.height;
    if (run >= runs()) return;
    const uint first = run * RUN;
    const uint end = min(first + RUN, push.width);
    const uint base = row * push.width;
    const float each = 1.0 / (3.0 * float(push.width) * float(push.height));
    const float of_l1 = (1.0 - push.lambda) * each;
    const float of_ssim = -push.lambda * each;
    Window window = window_empty();
    float sum = 0.0;
    for (uint i = first; i < end + 2u * WINDOW_RADIUS; ++i) {
        const uint column = i - WINDOW_RADIUS;
        vec4 derivatives = vec4(0.0);
        if (column < push.width) derivatives.xyz = planes[base + column].xyz;
        const vec4 spread = window_take(window, derivatives);
        if (i >= first + 2u * WINDOW_RADIUS) {
            const uint k = base + column - WINDOW_RADIUS;
            const float x = image[4u * k + push.channel];
            const float d = x - photograph(target[k]);
            sum += abs(d);
            grad_image[4u * k + push.channel] =
                of_l1 * sign(d) + of_ssim * (spread.x + d * spread.y + (x - PIVOT) * spread.z);
            if (push.channel == 0u) grad_image[4u * k + 3u] = 0.0;
        }
    }
    l1_parts[push.channel * push.height * runs() + global_index()] = sum;
}
