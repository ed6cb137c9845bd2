// How the interface lies over a picture, once for GLSL and C++: the host's frames and the device's
// are the same bytes.
#ifndef VIEW_COMPOSE_H
#define VIEW_COMPOSE_H
#include "common/shared.h"
#ifdef __cplusplus
#define SHARED_FUNCTION inline
#else
#define SHARED_FUNCTION
#endif
SHARED_BEGIN
// Two of four bytes, the lower ones of both halves, times share / 255 in [0,1], to the nearest.
SHARED_FUNCTION uint scaledPair(uint pair, uint share) {
    uint sum = (pair & 0xff00ffu) * share + 0x800080u;
    return (sum + (sum >> 8 & 0xff00ffu)) >> 8 & 0xff00ffu;
}
// R, G, B, A as a surface wants them: with blueFirst B, G, R, A.
SHARED_FUNCTION uint inOrder(uint pixel, uint blueFirst) {
    return blueFirst == 0u
               ? pixel
               : (pixel & 0xff00ff00u) | (pixel & 0xffu) << 16 | (pixel >> 16 & 0xffu);
}
// A layer's pixel (colours times opacity) over an opaque one, opaque, in that order. No byte of a
// layer is above its opacity, so that no sum is above 255.
SHARED_FUNCTION uint composed(uint below, uint layer, uint blueFirst) {
    uint clear = 255u - (layer >> 24);
    return inOrder(layer + (scaledPair(below, clear) | scaledPair(below >> 8, clear) << 8),
                   blueFirst);
}
SHARED_END
#endif
