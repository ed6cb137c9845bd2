#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_KHR_shader_subgroup_ballot : require
#include "common/op.glsl"
#define GEMM_TEXELS 1
#include "linalg/gemm.glsl"

ENTRY(tile) { gemmTile(); }
