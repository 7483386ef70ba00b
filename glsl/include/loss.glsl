// Shared by the passes of the image loss. The loss is (1 - lambda) mean |x - y| + lambda (1 - mean SSIM) of render x
// and photograph y over pixels and channels; outside the image both are 0 (zero padding). A pixel of the photograph
// with alpha 0 is masked: the render counts as equal to the photograph there and has no gradient, and both means
// exclude the pixel.
//
// With m = mean x - mean y, V = variance of x - y and v1 + v2 = the sum of the variances in the window,
//     SSIM = (1 - m^2 / A) (1 - V / B),  A = mu1^2 + mu2^2 + C1,  B = v1 + v2 + C2,
// which is the usual form rewritten. All moments of the difference come from differences, so nothing cancels where the
// images are alike: equal images give exactly 1 and a gradient of exactly 0. The variances are taken about a pivot of
// 1/2.
//
// WEIGHTED: each pixel's |x - y| and each window's 1 - SSIM count by the weight of the pixel, which is linear in its
// saliency. Only the gradient has the weights; the sums have none, so that losses compare between different weights.
#ifndef LOSS_GLSL
#define LOSS_GLSL

#extension GL_EXT_control_flow_attributes : require
#ifdef SUBGROUP_EMULATED
#define LOCAL_SIZE 64
#endif
#include "subgroup.glsl"
#include "common.glsl"
#include "loads.glsl"
#include "window.glsl"

#ifdef SUBGROUP_EMULATED
layout(local_size_x = 64) in;
#else
layout(local_size_x = 8, local_size_x_id = 0) in;  // the subgroup's width, or a multiple
#endif

const float PIVOT = 0.5;
const float C1 = 1e-4;
const float C2 = 9e-4;

layout(push_constant) uniform Push {
    uint width;
    uint height;
    float lambda;  // weight of 1 - SSIM
    float values;  // channels times pixels that are not masked
    float low_weight;   // weight of a pixel with saliency 0 ...
    float high_weight;  // ... and of one with saliency 1, where WEIGHTED
} push;

// Number of this subgroup in the dispatch, which determines its strip or row.
uint owner() { return group_index() * subgroup_count() + subgroup_number(); }

// APART: a subgroup owns one channel.
#ifdef APART
#define CHANNELS 1u
#else
#define CHANNELS 3u
#endif

// First channel of this subgroup.
uint first_channel() { return owner() % (3u / CHANNELS); }

// The columns beside a strip that a lane loads for its neighbours, see window_across: only the lanes at the strip's edges
// load any, and in a subgroup of at least 10 lanes one each, x. Narrower subgroups load a second, y. ~0 for none.
uvec2 columns_beside(uint column, uint lanes) {
    const uint lane = subgroup_lane();
    const uint beside = lane < WINDOW_RADIUS ? column + lanes : lane >= lanes - WINDOW_RADIUS ? column - lanes : ~0u;
    return lanes < 2u * WINDOW_RADIUS ? uvec2(column - lanes, column + lanes) : uvec2(beside, ~0u);
}

#endif
