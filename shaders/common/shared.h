// Lets one struct be read by GLSL (scalar layout) and by C++: four-byte members only.
#ifndef COMMON_SHARED_H
#define COMMON_SHARED_H
#ifdef __cplusplus
#include <cstdint>
#define SHARED_BEGIN namespace doppel { using uint = uint32_t;
#define SHARED_END }
#else
#define SHARED_BEGIN
#define SHARED_END
#endif
#endif
