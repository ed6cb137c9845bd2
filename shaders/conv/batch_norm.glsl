// What the passes of batch normalisation work on: single pixels, or, on CPUs, pairs of them
// (common/loads.glsl). Where images have an odd number of pixels, CPUs take the plain kernels too.
#include "common/loads.glsl"
#if CPU
#define Element Pair
#define Value vec2
#define WIDTH 2
Value value(Element e) { return unpackPair(e); }
Element element(Value v) { return packPair(v); }
float horizontal(Value v) { return v.x + v.y; }
Value rectified(Value v, Value sign, float slope) {
    return mix(slope * v, v, greaterThan(sign, Value(0)));
}
#else
#define Element float
#define Value float
#define WIDTH 1
Value value(Element e) { return e; }
Element element(Value v) { return v; }
float horizontal(Value v) { return v; }
Value rectified(Value v, Value sign, float slope) { return sign > 0 ? v : slope * v; }
#endif
