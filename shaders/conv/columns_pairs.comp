#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#include "common/op.glsl"
#include "conv/params.h"
#include "conv/columns.glsl"
#define TEXEL_LOADS 0
#include "conv/columns_pairs.glsl"

ENTRY(gather) { gatherPairs(); }
