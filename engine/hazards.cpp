#include "engine/hazards.h"

#include <algorithm>

namespace doppel {

bool HazardTracker::needsBarrier(const std::vector<Access>& accesses) const {
    return std::ranges::any_of(accesses, [&](const Access& next) {
        return std::ranges::any_of(pending_, [&](const Access& past) {
            bool overlap = next.begin < past.end && past.begin < next.end;
            return overlap && (next.writes || past.writes);
        });
    });
}

void HazardTracker::add(const std::vector<Access>& accesses) {
    pending_.insert(pending_.end(), accesses.begin(), accesses.end());
}

}  // namespace doppel
