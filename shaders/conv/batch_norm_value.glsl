// What the passes of batch normalisation work on: single pixels, or, where their number is even,
// pairs of them (PAIRS = 1; common/pairs.glsl says why).
#if PAIRS
#include "common/pairs.glsl"
#define Element uint64_t
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
