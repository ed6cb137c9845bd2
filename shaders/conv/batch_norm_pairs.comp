#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#define PAIRS 1
#include "conv/batch_norm.glsl"

ENTRY(sum_values) { sumValues(); }
ENTRY(normalise) { normalise(); }
ENTRY(sum_gradients) { sumGradients(); }
ENTRY(input_gradient) { inputGradient(); }
