#ifndef BODY_PARAMS_H
#define BODY_PARAMS_H
#include "common/constants.h"
SHARED_BEGIN
struct BodyParams {
    uint vertices;
    uint influences;  // joints per vertex
    uint chunks;      // partial sums of this reduction
};
struct BendFingersParams {
    uint vertices;
    uint amounts;  // that turns take their angles by
};
SHARED_CONSTANT int kFingerTurns = 4;  // of a finger, one after another
// Vertices, or joint influences, that one invocation sums; the sums of these sums come next.
SHARED_CONSTANT int kBodyChunk = 64;
SHARED_END
#endif
