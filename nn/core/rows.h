// Ops on some rows of tensors [V,…], which the host lists before a replay, kRowsListed at a time.
// The other rows keep what earlier replays left there, which holds as long as nothing that they
// depend on has changed since.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "common/rows.h"
#include "nn/core/graph.h"

namespace doppel {

// Which rows an op computes; empty: all of them. The op keeps its result (Graph::keep).
class ListedRows {
public:
    explicit operator bool() const { return static_cast<bool>(control_); }
    // What a kernel takes as `listed` (shaders/common/rows.glsl).
    Tensor list(Graph& graph) const;
    // [3], of an indirect dispatch: a workgroup in x for every so many of the list (64 at most).
    Tensor groups(uint32_t each, uint32_t y = 1, uint32_t z = 1) const;

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

    const ListedRows& operator[](size_t list) const { return lists_.at(list); }
    // Times kRowsListed: all rows.
    size_t count() const { return count_; }
    // wanted: for each list count() numbers, not 0 where those rows are to be computed.
    void write(std::span<const std::vector<uint8_t>> wanted);

private:
    Graph& graph_;
    size_t count_;
    Tensor control_;
    std::vector<ListedRows> lists_;
    std::vector<int32_t> values_;
};

// Adds a dispatch of `invocations`, or, of these, of perListed for each kRowsListed listed rows.
template <typename Params>
void dispatchRows(Graph& graph, const char* kernel, const ListedRows& rows,
                  std::initializer_list<Argument> arguments, const Params& params,
                  uint64_t invocations, uint32_t perListed = kRowsListed,
                  Specialisation spec = {}) {
    if (!rows) return graph.dispatch(kernel, arguments, params, invocations, spec);
    constexpr uint32_t kMostInvocations = 512;  // of a workgroup, on devices that take rows
    uint32_t each = 1;
    while (each < 64 && 2 * each * perListed <= kMostInvocations) each *= 2;
    spec["local_size"] = each * perListed;
    spec["kListedInvocations"] = perListed;
    graph.dispatchIndirect(kernel, arguments, params, rows.groups(each), spec);
}

}  // namespace doppel
