#ifndef BENCH_PARAMS_H
#define BENCH_PARAMS_H
#include "common/shared.h"
SHARED_BEGIN
struct CeilingParams {
    uint n;       // elements of four floats
    uint rounds;  // fma: how often each invocation goes round
};
SHARED_END
#endif
