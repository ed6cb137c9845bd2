#ifndef COMMON_ROWS_H
#define COMMON_ROWS_H
#include "common/shared.h"
SHARED_BEGIN
// Rows of a tensor that are computed or left out together, see nn/core/rows.h.
#ifdef __cplusplus
constexpr uint kRowsListed = 4;
#else
const uint kRowsListed = 4;
#endif
SHARED_END
#endif
