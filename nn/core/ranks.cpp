#include "nn/core/ranks.h"

#include <algorithm>

#include "engine/error.h"

namespace doppel {

void Ranks::barrier() {
    std::vector<std::byte> all(static_cast<size_t>(size()));
    const std::byte mine{};
    allGather(&mine, all.data(), 1);
}

void Ranks::average(std::span<float> values) {
    const auto ranks = static_cast<size_t>(size()), own = static_cast<size_t>(rank());
    const size_t each = (values.size() + ranks - 1) / ranks, bytes = each * sizeof(float);
    if (each == 0) return;
    out_.assign(each * ranks, 0);
    in_.resize(each * ranks);
    std::ranges::copy(values, out_.begin());
    allToAll(std::as_bytes(std::span(out_)).data(), std::as_writable_bytes(std::span(in_)).data(),
             bytes);
    std::vector<float> slice(each);
    const double part = 1 / static_cast<double>(ranks);
    for (size_t i = 0; i < each; ++i) {
        double sum = 0;
        for (size_t r = 0; r < ranks; ++r) sum += static_cast<double>(in_[r * each + i]);
        slice[i] = static_cast<float>(sum * part);
    }
    allGather(std::as_bytes(std::span(slice)).data(),
              std::as_writable_bytes(std::span(out_)).data(), bytes);
    std::copy_n(out_.begin(), values.size(), values.begin());
    // Its own slice stays where it is.
    const size_t begin = std::min(values.size(), own * each);
    const size_t kept = std::min(values.size(), begin + each) - begin;
    bytesSent_ += sizeof(float) * (values.size() - kept + kept * (ranks - 1));
}

void Ranks::gather(std::span<const float> mine, std::span<float> all, size_t rows) {
    const auto ranks = static_cast<size_t>(size());
    CHECK(all.size() == ranks * mine.size() && rows > 0 && mine.size() % rows == 0,
          "{} numbers of {} ranks in {} rows fill {}", mine.size(), ranks, rows, all.size());
    in_.resize(all.size());
    allGather(std::as_bytes(mine).data(), std::as_writable_bytes(std::span(in_)).data(),
              mine.size_bytes());
    bytesSent_ += mine.size_bytes() * (ranks - 1);
    const size_t n = mine.size() / rows;
    for (size_t row = 0; row < rows; ++row)
        for (size_t r = 0; r < ranks; ++r)
            std::copy_n(&in_[r * mine.size() + row * n], n, &all[(row * ranks + r) * n]);
}

}  // namespace doppel
