// What changes from step to step; the host writes it between replays of a recording.
#ifndef COMMON_STEP_PARAMS_H
#define COMMON_STEP_PARAMS_H
#include "common/shared.h"
SHARED_BEGIN
struct StepParams {
    uint step;              // counts from 1
    uint seed;              // of this run; random numbers are a hash of (seed, step, element)
    uint frame;             // row of the per-frame tables that this step works on
    float learningRate;
    float beta1Correction;  // 1 - beta1^step
    float beta2Correction;  // 1 - beta2^step
    float lossWeight;       // free for the stage, e.g. an annealed weight
    float reserved;
};
SHARED_END
#endif
