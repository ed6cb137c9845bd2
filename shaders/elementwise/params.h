#ifndef ELEMENTWISE_PARAMS_H
#define ELEMENTWISE_PARAMS_H
#include "common/shared.h"
SHARED_BEGIN
struct LeakyReluParams {
    uint n;       // elements
    float slope;  // of the negative side
};
struct AddParams {
    uint n;
};
SHARED_END
#endif
