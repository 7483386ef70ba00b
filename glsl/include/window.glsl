// SSIM's window along one axis: 11 taps of a Gaussian with sigma 1.5. Down a column as a filter over a stream of
// values; along a row over the lanes of a subgroup and of its two neighbours.
#ifndef WINDOW_GLSL
#define WINDOW_GLSL

const uint WINDOW_RADIUS = 5u;
const float WINDOW[6] = float[6](0.00102838008, 0.00759875814, 0.0360007721, 0.109360690, 0.213005538, 0.266011725);

// The ten partial sums. pending[j] belongs to the value at offset j - 5 from the last value.
struct Window {
    vec4 pending[10];
};

Window window_empty() {
    Window w;
    [[unroll]] for (uint j = 0u; j < 10u; ++j) w.pending[j] = vec4(0.0);
    return w;
}

// Takes the next value; returns the weighted sum around the value five positions before.
vec4 window_take(inout Window w, vec4 x) {
    vec4 term[6];
    [[unroll]] for (uint j = 0u; j < 6u; ++j) term[j] = WINDOW[j] * x;
    const vec4 done = w.pending[0] + term[0];
    [[unroll]] for (uint j = 0u; j < 9u; ++j) w.pending[j] = w.pending[j + 1u] + term[j < 5u ? j + 1u : 9u - j];
    w.pending[9] = term[0];
    return done;
}

vec4 window_shuffle(vec4 x, uint lane) {
    return vec4(subgroup_shuffle(x.x, lane), subgroup_shuffle(x.y, lane), subgroup_shuffle(x.z, lane),
        subgroup_shuffle(x.w, lane));
}

// The weighted sum around each lane of `here`, where lanes stand for neighbouring columns, `left` and `right` for the
// columns of the subgroup's width on either side.
vec4 window_across(vec4 left, vec4 here, vec4 right) {
    const uint width = subgroup_width();
    const uint lane = subgroup_lane();
    vec4 sum = WINDOW[5] * here;
    [[unroll]] for (uint j = 1u; j <= 5u; ++j) {
        const vec4 before = window_shuffle(lane >= width - j ? left : here, (lane + width - j) & (width - 1u));
        const vec4 after = window_shuffle(lane < j ? right : here, (lane + j) & (width - 1u));
        sum += WINDOW[5u - j] * (before + after);
    }
    return sum;
}

#endif
