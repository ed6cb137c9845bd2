// Kernels that compute rows of a tensor, all of them or those that a list names, kRowsListed at a
// time (nn/core/rows.h). LISTED_ROWS(slot) declares the list, which is a buffer like any other;
// kernels take listedIndex() for linearIndex().
#include "common/rows.h"
layout(constant_id = 20) const uint kListedInvocations = 0;  // of kRowsListed rows; 0: all rows

#define LISTED_ROWS(slot)                        \
    BUFFER(slot, readonly, uint, listed);        \
    uint listedIndex() {                         \
        uint i = linearIndex();                  \
        if (kListedInvocations == 0) return i;   \
        uint place = i / kListedInvocations;     \
        return listed.d[place] * kListedInvocations + (i - place * kListedInvocations); \
    }
