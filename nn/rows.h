// Ops on some rows of tensors [V,…]: tiles of kRowTile rows that the host lists before a replay.
// The other rows keep what earlier replays left there, which holds as long as nothing that they
// depend on has changed since.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "nn/graph.h"

namespace doppel {

constexpr uint32_t kRowTile = 32;

// Which rows an op computes; empty: all of them. The op keeps its result (Graph::keep).
class RowTiles {
public:
    explicit operator bool() const { return static_cast<bool>(control_); }
    // What a kernel takes as `tiles` (shaders/common/rows.glsl).
    Tensor list(Graph& graph) const;
    // [3], of an indirect dispatch: a workgroup in x for every so many tiles (1, 2, 4 or 8).
    Tensor groups(uint32_t tilesEach, uint32_t y = 1, uint32_t z = 1) const;

private:
    friend class RowLists;
    using Dispatch = std::array<uint32_t, 3>;
    Tensor control_;
    std::shared_ptr<std::vector<Dispatch>> dispatches_;  // that groups() was asked for
};

// Lists of one graph, an input of it.
class RowLists {
public:
    RowLists(Graph& graph, int64_t rows, size_t lists);

    const RowTiles& operator[](size_t list) const { return lists_.at(list); }
    size_t tileCount() const { return tiles_; }
    // wanted: for each list tileCount() numbers, not 0 where the tile is to be computed.
    void write(std::span<const std::vector<uint8_t>> wanted);

private:
    Graph& graph_;
    size_t tiles_;
    Tensor control_;
    std::vector<RowTiles> lists_;
    std::vector<int32_t> values_;
};

// Adds a dispatch of `invocations`, or, of these, of perTile for each listed tile.
template <typename Params>
void dispatchRows(Graph& graph, const char* kernel, const RowTiles& rows,
                  std::initializer_list<Argument> arguments, const Params& params,
                  uint64_t invocations, uint32_t perTile = kRowTile, Specialisation spec = {}) {
    if (!rows) return graph.dispatch(kernel, arguments, params, invocations, spec);
    constexpr uint32_t kMostInvocations = 512;  // of a workgroup, on devices that take rows
    uint32_t each = 1;
    while (each < 8 && 2 * each * perTile <= kMostInvocations) each *= 2;
    spec["local_size"] = each * perTile;
    spec["kTileInvocations"] = perTile;
    graph.dispatchIndirect(kernel, arguments, params, rows.groups(each), spec);
}

}  // namespace doppel
