#ifndef FIT_PARAMS_H
#define FIT_PARAMS_H
#include "common/shared.h"
SHARED_BEGIN
// A pose row: 24 joint rotations (axis-angle, radians), then a translation (metres).
#define POSE_ROW_LENGTH 75
struct SelectRowParams {
    uint rows, columns;
    uint word;   // which element of the index buffer holds the row's number
    int offset;  // added to it; the sum is clamped to the table
};
struct PoseCorrectionParams {
    float transScale;  // metres of translation per unit of correction
};
struct PosePriorParams {
    float pose, trans, smoothness, shape;  // weights
};
struct PoseLikelihoodParams {
    float likely, limits;  // weights
};
struct BalanceParams {
    uint joints;
    float deviation;  // m
    float level;      // weight
};
struct WeightedSumParams {
    float weightA, weightB, weightC, weightD;
};
SHARED_END
#endif
