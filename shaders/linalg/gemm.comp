#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#define GEMM_TEXELS 0
#include "linalg/gemm.glsl"

ENTRY(tile) { gemmTile(); }
