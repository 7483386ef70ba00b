#version 460
// loss_columns: the window along columns, SSIM, its derivatives with respect to the moments, and the window along columns of those.
// In place: row y is read before row y - 10 is written, by the thread that owns the column.
// One thread owns a column; a workgroup of 8 threads owns 8 consecutive columns.
#extension GL_GOOGLE_include_directive : require
layout(local_size_x = 8) in;
#include "loss.glsl"
layout(set = 0, binding = 0) buffer Planes { vec4 planes[]; };
layout(set = 0, binding = 1) writeonly buffer SsimParts { float ssim_parts[]; };

void main() {
    const uint column = global_index();
    if (column >= push.width) return;
    Window moments = window_empty();
    Window back = window_empty();
    float sum = 0.0;
    for (uint i = 0u; i < push.height + 4u * WINDOW_RADIUS; ++i) {
        const uint taken = i - WINDOW_RADIUS;
        // A row outside the image: x = y = 0.
        vec4 row = vec4(-PIVOT, 0.0, 0.0, 2.0 * PIVOT * PIVOT);
        if (taken < push.height) row = planes[taken * push.width + column];
        const vec4 mean = window_take(moments, row);

        const uint center = taken - WINDOW_RADIUS;
        vec4 derivatives = vec4(0.0);
        if (center < push.height) {
            const float m = mean.y;
            const float mu1 = mean.x + PIVOT;
            const float mu2 = mu1 - m;
            const float pivoted2 = mean.x - m;
            const float a = mu1 * mu1 + mu2 * mu2 + C1;
            const float b = max(mean.w - mean.x * mean.x - pivoted2 * pivoted2, 0.0) + C2;
            const float v = max(mean.z - m * m, 0.0);
            const float inv_a = 1.0 / a;
            const float inv_b = 1.0 / b;
            const float luminance = 1.0 - m * m * inv_a;
            const float structure = 1.0 - v * inv_b;
            sum += luminance * structure;
            const float of_b = 2.0 * luminance * v * inv_b * inv_b;
            derivatives.x = 2.0 * structure * m * inv_a * (mu1 * m * inv_a - 1.0) + 2.0 * luminance * m * inv_b - of_b * mean.x;
            derivatives.y = -2.0 * luminance * inv_b;
            derivatives.z = of_b;
        }
        const vec4 spread = window_take(back, derivatives);
        const uint done = center - WINDOW_RADIUS;
        if (done < push.height) planes[done * push.width + column] = spread;
    }
    ssim_parts[push.channel * push.width + column] = sum;
}
