// Work on the frames of a capture, by threads and by the processes that train together.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <future>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "nn/core/ranks.h"

namespace doppel {

// As many threads as work on frames at a time: the processor's, and eight at most, for each holds
// pictures of some ten MB.
size_t workers();

// Calls make(i) for each i below count, on threads, and take(i, what it made) on this one, in
// ascending order of i. An exception of either is thrown once the threads under way have ended.
template <typename Make, typename Take>
void inParallel(size_t count, const Make& make, const Take& take) {
    std::deque<std::future<std::invoke_result_t<const Make&, size_t>>> underWay;
    for (size_t i = 0, next = 0; i < count; ++i) {
        for (; next < count && underWay.size() < workers(); ++next)
            underWay.push_back(std::async(std::launch::async, std::cref(make), next));
        auto made = underWay.front().get();
        underWay.pop_front();
        take(i, std::move(made));
    }
}

// Things are handed out to ranks in turns: rank r does r, r + size, r + 2 size, and so on.
inline bool isMine(const Ranks* ranks, size_t i) {
    return i % static_cast<size_t>(sizeOf(ranks)) == static_cast<size_t>(rankOf(ranks));
}

// make(i), on threads of the rank whose it is, gives the bytes of one of `count` things; take(i,
// bytes), on this thread, gets those of all on every rank, in ascending order of i. All ranks call
// it alike. Throws Interrupted on all ranks where one of them was, unless it is not to be stopped.
void shareWork(Ranks* ranks, size_t count, const std::function<std::vector<uint8_t>(size_t)>& make,
               const std::function<void(size_t, std::span<const uint8_t>)>& take,
               bool canStop = true);

// Throws Interrupted on all ranks where one of them was. All ranks call it alike.
void stopIfInterrupted(Ranks* ranks);

// One number of each of `count` things; each rank gives its own ones, in ascending order.
std::vector<double> ofAllRanks(Ranks* ranks, size_t count, std::span<const double> mine);

// Each rank's numbers become the sums over all ranks, added in the order of ranks, with the same
// bits everywhere.
void sumOverRanks(Ranks* ranks, std::span<double> values);

}  // namespace doppel
