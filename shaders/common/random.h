// Random bits as a hash of counters: the same on every device, in GLSL and in C++, and no state
// to keep. The mixing step is PCG's output permutation (O'Neill 2014) as Jarzynski and Olano
// (JCGT 2020) recommend it.
#ifndef COMMON_RANDOM_H
#define COMMON_RANDOM_H
#include "common/constants.h"
SHARED_BEGIN
SHARED_FUNCTION uint mixBits(uint v) {
    uint state = v * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28) + 4u)) ^ state) * 277803737u;
    return (word >> 22) ^ word;
}
// stream keeps the users of one seed and step apart.
SHARED_FUNCTION uint randomBits(uint seed, uint step, uint stream, uint element) {
    return mixBits(element ^ mixBits(stream ^ mixBits(step ^ mixBits(seed))));
}
SHARED_END
#endif
