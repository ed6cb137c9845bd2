#ifndef MESH_PARAMS_H
#define MESH_PARAMS_H
#include "common/shared.h"
SHARED_BEGIN
struct MeshParams {
    uint n;       // vertices, or faces
    float scale;  // of a loss: one over the number of its terms
};
SHARED_END
#ifdef __cplusplus
namespace doppel {
#endif
const float kNormalEpsilon = 1e-6f; // m^2; see vertexNormals()
#ifdef __cplusplus
}
#endif
#endif
