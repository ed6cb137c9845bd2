#include "nn/rows.h"

#include <algorithm>

namespace doppel {

namespace {

// A list's part of the control: the numbers of workgroups of kMostDispatches kinds of dispatches,
// four words each so that all begin at multiples of 16 bytes, and the tiles. Behind them one that
// no tensor has fills the last workgroup.
constexpr size_t kMostDispatches = 8, kMostEach = 8;

size_t wordsOf(size_t tiles) { return 4 * kMostDispatches + (tiles + kMostEach + 3) / 4 * 4; }

}  // namespace

Tensor RowTiles::list(Graph& graph) const {
    if (!control_) return graph.none();
    constexpr int64_t kBegin = 4 * kMostDispatches;
    return control_.slice(kBegin, control_.dim(0) - kBegin);
}

Tensor RowTiles::groups(uint32_t tilesEach, uint32_t y, uint32_t z) const {
    CHECK(tilesEach > 0 && tilesEach <= kMostEach, "a workgroup has up to {} tiles", kMostEach);
    Dispatch dispatch{tilesEach, y, z};
    auto found = std::ranges::find(*dispatches_, dispatch);
    if (found == dispatches_->end()) {
        CHECK(dispatches_->size() < kMostDispatches, "a list has up to {} kinds of dispatches",
              kMostDispatches);
        found = dispatches_->insert(found, dispatch);
    }
    return control_.slice(4 * (found - dispatches_->begin()), 4);
}

RowLists::RowLists(Graph& graph, int64_t rows, size_t lists)
    : graph_(graph), tiles_((static_cast<size_t>(rows) + kRowTile - 1) / kRowTile) {
    auto words = static_cast<int64_t>(wordsOf(tiles_));
    control_ = graph.input({static_cast<int64_t>(lists) * words}, ElementType::I32);
    for (size_t i = 0; i < lists; ++i) {
        RowTiles& list = lists_.emplace_back();
        list.control_ = control_.slice(static_cast<int64_t>(i) * words, words);
        list.dispatches_ = std::make_shared<std::vector<RowTiles::Dispatch>>();
    }
    values_.resize(static_cast<size_t>(control_.elements()));
}

void RowLists::write(std::span<const std::vector<uint8_t>> wanted) {
    CHECK(wanted.size() == lists_.size(), "each of {} lists is written", lists_.size());
    size_t words = wordsOf(tiles_);
    for (size_t i = 0; i < wanted.size(); ++i) {
        int32_t* control = &values_[i * words];
        int32_t* tiles = control + 4 * kMostDispatches;
        uint32_t count = 0;
        for (size_t tile = 0; tile < tiles_; ++tile)
            if (wanted[i].at(tile)) tiles[count++] = static_cast<int32_t>(tile);
        std::fill_n(&tiles[count], kMostEach, static_cast<int32_t>(tiles_));
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
