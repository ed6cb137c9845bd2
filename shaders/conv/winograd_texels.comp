#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "common/op.glsl"
#include "common/pairs.glsl"
#include "conv/params.h"
#include "conv/winograd.glsl"
#define TEXEL_LOADS 1
#include "conv/winograd_tiles.glsl"

ENTRY(fine_to_tiles) { fineToTiles(); }
ENTRY(coarse_to_tiles) { coarseToTiles(); }
