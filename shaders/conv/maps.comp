// Feature maps of several images side by side, so that one product makes or reads all of them:
// joined[feature, image, window] = maps[image, feature, window], and back.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "conv/params.h"
PARAMS(MapsParams, 2)
BUFFER(0, readwrite, float, maps);    // [images, features, windows]
BUFFER(1, readwrite, float, joined);  // [features, images * windows]

uint place(uint i) {
    uint plane = quotient(i, params.byWindows), window = remainder(i, plane, params.byWindows);
    uint image = quotient(plane, params.byFeatures);
    uint feature = remainder(plane, image, params.byFeatures);
    return (feature * params.images + image) * params.windows + window;
}

ENTRY(join) {
    uint i = linearIndex();
    if (i >= params.elements) return;
    joined.d[place(i)] = maps.d[params.start + i];
}

ENTRY(part) {
    uint i = linearIndex();
    if (i >= params.elements) return;
    maps.d[params.start + i] = joined.d[place(i)];
}
