// The weight of a pixel in the gradient of the loss; include after loss.glsl and the declaration of `saliency`.
#ifndef LOSS_WEIGHT_GLSL
#define LOSS_WEIGHT_GLSL

layout(constant_id = 3) const uint WEIGHTED = 0u;

float weight_at(uint k) {
    return WEIGHTED == 0u ? 1.0 : push.low_weight + (push.high_weight - push.low_weight) * saliency[k];
}

#endif
