#ifndef BODY_PARAMS_H
#define BODY_PARAMS_H
#include "common/shared.h"
SHARED_BEGIN
struct BodyParams {
    uint vertices;
    uint influences;  // joints per vertex
    uint chunks;      // partial sums of this reduction
};
SHARED_END
#ifdef __cplusplus
namespace doppel {
#endif
// Vertices, or joint influences, that one invocation sums; the sums of these sums come next.
const int kBodyChunk = 64;
#ifdef __cplusplus
}
#endif
#endif
