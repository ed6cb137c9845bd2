#ifndef ELEMENTWISE_PARAMS_H
#define ELEMENTWISE_PARAMS_H
#include "common/divide.h"
#include "common/shared.h"
SHARED_BEGIN
struct LeakyReluParams {
    uint n;       // elements
    float slope;  // of the negative side
};
struct AddParams {
    uint n;
};
struct ElementParams {
    uint n;
};
struct ScaleShiftParams {
    uint n;
    float scale, shift;
};
struct ClampParams {
    uint n;
    float low, high;
};
struct ConcatParams {
    uint n;               // elements of y; backward: of da or db
    uint innerA, innerB;  // y[outer, innerA + innerB]
    Divisor byInner;      // innerA + innerB; backward: innerA or innerB
};
struct DropoutParams {
    uint n;
    uint stream;     // keeps the dropouts of a network apart
    uint threshold;  // an element is dropped where its random 32 bits are below
    float scale;     // of those that stay
};
SHARED_END
#endif
