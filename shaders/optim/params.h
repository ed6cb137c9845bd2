#ifndef OPTIM_PARAMS_H
#define OPTIM_PARAMS_H
#include "common/blocks.h"
#include "common/shared.h"
SHARED_BEGIN
struct AdamWParams {
    uint n;     // elements that are updated
    uint rows;  // of the table, where one row is updated
    float beta1, beta2, epsilon, weightDecay;
    float rateScale;  // times the step's learning rate
    uint firstPair;   // of those
    Digits digits;
};
struct ClipParams {
    uint n;
    uint parts;  // sums of squares
    float maxNorm;
};
struct UniformAdamParams {
    uint rows;
    float beta1, beta2;
    float rateScale;  // times the step's learning rate
};
SHARED_END
#endif
