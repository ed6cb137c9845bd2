#ifndef BODY_PARAMS_H
#define BODY_PARAMS_H
#include "common/constants.h"
SHARED_BEGIN
struct BodyParams {
    uint vertices;
    uint influences;  // joints per vertex
    uint chunks;      // partial sums of this reduction
};
// Vertices, or joint influences, that one invocation sums; the sums of these sums come next.
SHARED_CONSTANT int kBodyChunk = 64;
SHARED_END
#endif
