#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#define PAIRS 1
#include "conv/batch_norm_channel.glsl"

ENTRY(forward) { forwardChannel(); }
ENTRY(backward) { backwardChannel(); }
