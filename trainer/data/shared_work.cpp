#include "trainer/data/shared_work.h"

#include <algorithm>
#include <thread>

#include "engine/error.h"
#include "trainer/data/progress.h"

namespace doppel {

namespace {

std::span<const std::byte> bytesOf(const auto& values) { return std::as_bytes(std::span(values)); }
std::byte* writable(auto& values) { return std::as_writable_bytes(std::span(values)).data(); }

}  // namespace

size_t workers() { return std::clamp<size_t>(std::thread::hardware_concurrency(), 1, 8); }

void shareWork(Ranks* ranks, size_t count, const std::function<std::vector<uint8_t>(size_t)>& make,
               const std::function<void(size_t, std::span<const uint8_t>)>& take, bool canStop) {
    const auto size = static_cast<size_t>(sizeOf(ranks)), own = static_cast<size_t>(rankOf(ranks));
    if (size == 1) {
        inParallel(count, make, [&](size_t i, const std::vector<uint8_t>& bytes) {
            if (canStop && interrupted()) throw Interrupted{};
            take(i, bytes);
        });
        return;
    }
    // So many of each rank travel together that threads have work, and a hundred ranks room.
    const size_t each = std::clamp<size_t>(64 / size, 1, 16);
    for (size_t begin = 0; begin < count; begin += each * size) {
        const auto at = [&](size_t k, size_t rank) { return begin + k * size + rank; };
        size_t mineCount = 0;
        while (mineCount < each && at(mineCount, own) < count) ++mineCount;
        std::vector<uint8_t> mine;
        std::vector<uint64_t> sizes(each + 1), all((each + 1) * size);
        inParallel(
            mineCount, [&](size_t k) { return make(at(k, own)); },
            [&](size_t k, const std::vector<uint8_t>& bytes) {
                sizes[k] = bytes.size();
                mine.insert(mine.end(), bytes.begin(), bytes.end());
            });
        // Those that wait for it have to stop as well.
        sizes[each] = canStop && interrupted() ? 1 : 0;
        ranks->allGather(bytesOf(sizes).data(), writable(all), (each + 1) * sizeof(uint64_t));
        const auto sizeFrom = [&](size_t k, size_t rank) { return all[rank * (each + 1) + k]; };
        std::vector<size_t> places(size);
        size_t longest = 0;
        bool stops = false;
        for (size_t rank = 0; rank < size; ++rank) {
            size_t sum = 0;
            for (size_t k = 0; k < each; ++k) sum += sizeFrom(k, rank);
            longest = std::max(longest, sum);
            stops = stops || sizeFrom(each, rank) > 0;
        }
        if (stops) throw Interrupted{};
        for (size_t rank = 0; rank < size; ++rank) places[rank] = rank * longest;
        mine.resize(longest);
        std::vector<uint8_t> theirs(longest * size);
        if (longest > 0) ranks->allGather(bytesOf(mine).data(), writable(theirs), longest);
        for (size_t k = 0; k < each; ++k)
            for (size_t rank = 0; rank < size && at(k, rank) < count; ++rank) {
                const size_t bytes = sizeFrom(k, rank);
                take(at(k, rank), std::span<const uint8_t>(theirs).subspan(places[rank], bytes));
                places[rank] += bytes;
            }
    }
}

void stopIfInterrupted(Ranks* ranks) {
    const std::vector<double> mine{interrupted() ? 1.0 : 0.0};
    for (double said : ofAllRanks(ranks, static_cast<size_t>(sizeOf(ranks)), mine))
        if (said > 0) throw Interrupted{};
}

std::vector<double> ofAllRanks(Ranks* ranks, size_t count, std::span<const double> mine) {
    const auto size = static_cast<size_t>(sizeOf(ranks));
    if (size == 1) return {mine.begin(), mine.end()};
    const size_t each = (count + size - 1) / size;
    std::vector<double> padded(each), theirs(each * size), all;
    CHECK(mine.size() <= each, "a rank has {} of {} numbers, not {}", each, count, mine.size());
    std::ranges::copy(mine, padded.begin());
    ranks->allGather(bytesOf(padded).data(), writable(theirs), each * sizeof(double));
    for (size_t i = 0; i < count; ++i) all.push_back(theirs[i % size * each + i / size]);
    return all;
}

void sumOverRanks(Ranks* ranks, std::span<double> values) {
    const auto size = static_cast<size_t>(sizeOf(ranks));
    if (size == 1 || values.empty()) return;
    const size_t each = (values.size() + size - 1) / size;
    std::vector<double> out(each * size), in(each * size), slice(each);
    std::ranges::copy(values, out.begin());
    ranks->allToAll(bytesOf(out).data(), writable(in), each * sizeof(double));
    for (size_t rank = 0; rank < size; ++rank)
        for (size_t i = 0; i < each; ++i) slice[i] += in[rank * each + i];
    ranks->allGather(bytesOf(slice).data(), writable(out), each * sizeof(double));
    std::copy_n(out.begin(), values.size(), values.begin());
}

}  // namespace doppel
