#ifndef MESH_PARAMS_H
#define MESH_PARAMS_H
#include "common/shared.h"
SHARED_BEGIN
struct MeshParams {
    uint n;       // vertices, or faces
    float scale;  // of a loss: one over the number of its terms
};
struct SumParams {
    uint n;
    float scale;
};
SHARED_END
#ifdef __cplusplus
namespace doppel {
#endif
const int kSumChunk = 64;           // numbers that one invocation adds up
const float kNormalEpsilon = 1e-6f; // m^2; see vertexNormals()
#ifdef __cplusplus
}
#endif
#endif
