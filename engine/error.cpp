#include "engine/error.h"

#include <cstdio>
#include <cstdlib>

namespace doppel {

void checkFailed(const char* file, int line, const char* condition, const std::string& sentence) {
    fmt::print(stderr, "doppel: internal error at {}:{}: {} ({})\n", file, line, sentence,
               condition);
    std::abort();
}

}  // namespace doppel
