#version 460
#extension GL_GOOGLE_include_directive : require
#define KEYS 0
#include "raster/visibility.glsl"

ENTRY(small) { drawSmall(); }
ENTRY(large) { drawLarge(); }
ENTRY(resolve) { resolvePixel(); }
