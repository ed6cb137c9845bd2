// The numbers of stage caps, which trains nothing: hair and loose cloth as surfaces of their own
// (trainer/stages/caps/caps.h).
#pragma once

#include "nn/core/numbers.h"

namespace doppel {

#define CAPS_NUMBERS(NUMBER, FLAG, CHOICE)                                                      \
    NUMBER(double, cell, 0, 0, .1,                                                              \
           "m, side of the cells in which masks are compared; 0: the stage is left out, as in " \
           "the paper")                                                                         \
    NUMBER(double, depth, .04, .01, .2,                                                         \
           "m beyond the body from which on what masks hold is hair or loose cloth; what is "   \
           "nearer is left to the body's own offsets")                                          \
    NUMBER(double, reach, .2, .02, .5, "m beyond the body that are looked at")                  \
    NUMBER(double, agree, .7, 0, 1, "part of the frames of each side whose masks hold a cell")  \
    NUMBER(double, litres, .15, 0, 100, "volume from which on it is worth a surface of its own")
struct CapsPreset {
    NUMBERS(CAPS_NUMBERS)
};

}  // namespace doppel
