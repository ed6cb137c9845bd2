// Constants and functions that GLSL and C++ share, beside the structs of common/shared.h.
#ifndef COMMON_CONSTANTS_H
#define COMMON_CONSTANTS_H
#include "common/shared.h"
#ifdef __cplusplus
#define SHARED_CONSTANT constexpr
#define SHARED_FUNCTION inline
#else
#define SHARED_CONSTANT const
#define SHARED_FUNCTION
#endif
#endif
