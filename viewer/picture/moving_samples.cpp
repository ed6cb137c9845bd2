#include "viewer/picture/moving_samples.h"

#include <algorithm>

namespace doppel {

void MovingSamples::drawn(double milliseconds) {
    if (first_) {
        first_ = false;
        return;
    }
    took_[count_++ % kCounted] = milliseconds;
    if (count_ < kCounted) return;
    if (samples_ == 1) {
        alone_ = *std::ranges::max_element(took_);
        return;
    }
    // One that had to wait for something else says nothing.
    const double least = *std::ranges::min_element(took_);
    if (least <= budget_) return;
    times_ = std::max(times_, least / std::max(alone_, 1e-3));
    samples_ = 1;
    count_ = 0;
}

void MovingSamples::rested() {
    if (first_) return;
    first_ = true;
    if (samples_ == 1 && count_ >= kCounted && times_ * alone_ <= budget_) samples_ = 2;
    count_ = 0;
}

}  // namespace doppel
