#ifndef ELEMENTWISE_PARAMS_H
#define ELEMENTWISE_PARAMS_H
#include "common/divide.h"
#include "common/shared.h"
SHARED_BEGIN
struct LeakyReluParams {
    uint n;       // elements
    float slope;  // of the negative side
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
// Copies a part [outer, inner] from or to its place in [outer, innerAll].
struct ConcatParams {
    uint n;  // elements of the part
    uint innerAll;
    uint start;  // of the part in a row
    Divisor byInner;
};
struct DropoutParams {
    uint n;
    uint stream;     // keeps the dropouts of a network apart
    uint threshold;  // an element is dropped where its random 32 bits are below
    float scale;     // of those that stay
    uint first;      // the number of x's first element among those of all ranks
};
SHARED_END
#endif
