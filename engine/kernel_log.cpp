#include "engine/kernel_log.h"

#include <mutex>

namespace doppel {

namespace {

struct Log {
    std::mutex mutex;
    std::set<std::string> lines;
};
Log& log() {
    static Log instance;
    return instance;
}

}  // namespace

void noteKernel(std::string_view kernel, bool descriptors) {
    std::string line = std::string(kernel) + (descriptors ? " descriptors" : " addresses");
    std::lock_guard lock(log().mutex);
    log().lines.insert(std::move(line));
}

std::set<std::string> notedKernels() {
    std::lock_guard lock(log().mutex);
    return log().lines;
}

}  // namespace doppel
