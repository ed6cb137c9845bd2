// Decides where a barrier is needed, from what each dispatch reads and writes.
#pragma once

#include <cstdint>
#include <vector>

namespace doppel {

struct Access {
    uint64_t begin = 0, end = 0;  // bytes [begin, end) in one address space for all buffers
    bool reads = false, writes = false;
};

// Accesses since the last barrier. A new dispatch needs a barrier before it when it reads what was
// written since (read after write), writes what was read (write after read) or writes what was
// written (write after write). On a CPU device a missing barrier still gives right answers and
// validation is blind to addresses, so this rule has tests of its own.
class HazardTracker {
public:
    bool needsBarrier(const std::vector<Access>& accesses) const;
    void add(const std::vector<Access>& accesses);
    void clear() { pending_.clear(); }

private:
    std::vector<Access> pending_;
};

}  // namespace doppel
