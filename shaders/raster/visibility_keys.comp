#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_shader_atomic_int64 : require
#define KEYS 1
#include "raster/visibility.glsl"

ENTRY(small) { drawSmall(); }
ENTRY(large) { drawLarge(); }
ENTRY(resolve) { resolvePixel(); }
