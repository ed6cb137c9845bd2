#include "nn/core/rows.h"

#include <algorithm>

namespace doppel {

namespace {

// A list's part of the control: the numbers of workgroups of kMostDispatches kinds of dispatches,
// four words each so that all begin at multiples of 16 bytes, and the list. Behind it rows that no
// tensor has fill the last workgroup.
constexpr size_t kMostDispatches = 8, kMostEach = 64;

size_t wordsOf(size_t count) { return 4 * kMostDispatches + (count + kMostEach + 3) / 4 * 4; }

}  // namespace

Tensor ListedRows::list(Graph& graph) const {
    if (!control_) return graph.none();
    constexpr int64_t kBegin = 4 * kMostDispatches;
    return control_.slice(kBegin, control_.dim(0) - kBegin);
}

Tensor ListedRows::groups(uint32_t each, uint32_t y, uint32_t z) const {
    CHECK(each > 0 && each <= kMostEach, "a workgroup has up to {} of a list", kMostEach);
    Dispatch dispatch{each, y, z};
    auto found = std::ranges::find(*dispatches_, dispatch);
    if (found == dispatches_->end()) {
        CHECK(dispatches_->size() < kMostDispatches, "a list has up to {} kinds of dispatches",
              kMostDispatches);
        found = dispatches_->insert(found, dispatch);
    }
    return control_.slice(4 * (found - dispatches_->begin()), 4);
}

RowLists::RowLists(Graph& graph, int64_t rows, size_t lists)
    : graph_(graph), count_((static_cast<size_t>(rows) + kRowsListed - 1) / kRowsListed) {
    auto words = static_cast<int64_t>(wordsOf(count_));
    control_ = graph.input({static_cast<int64_t>(lists) * words}, ElementType::I32);
    for (size_t i = 0; i < lists; ++i) {
        ListedRows& list = lists_.emplace_back();
        list.control_ = control_.slice(static_cast<int64_t>(i) * words, words);
        list.dispatches_ = std::make_shared<std::vector<ListedRows::Dispatch>>();
    }
    values_.resize(static_cast<size_t>(control_.elements()));
}

void RowLists::write(std::span<const std::vector<uint8_t>> wanted) {
    CHECK(wanted.size() == lists_.size(), "each of {} lists is written", lists_.size());
    size_t words = wordsOf(count_);
    for (size_t i = 0; i < wanted.size(); ++i) {
        int32_t* control = &values_[i * words];
        int32_t* list = control + 4 * kMostDispatches;
        CHECK(wanted[i].size() == count_, "all of {} are wanted or not", count_);
        uint32_t count = 0;
        for (size_t k = 0; k < count_; ++k)
            if (wanted[i][k]) list[count++] = static_cast<int32_t>(k);
        std::fill_n(&list[count], kMostEach, static_cast<int32_t>(count_));
        for (const auto& [each, y, z] : *lists_[i].dispatches_) {
            *control++ = static_cast<int32_t>((count + each - 1) / each);
            *control++ = static_cast<int32_t>(y);
            *control++ = static_cast<int32_t>(z);
            *control++ = 0;
        }
    }
    graph_.write(control_, values_);
}

}  // namespace doppel
