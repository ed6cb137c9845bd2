// Matrices of few numbers, in compressed sparse rows.
#pragma once

#include <cstdint>
#include <vector>

namespace doppel {

struct SparseMatrix {
    int64_t columns = 0;
    std::vector<int32_t> begin{0};  // [rows + 1] where a row's numbers begin
    std::vector<int32_t> column;    // of each number, below `columns`
    std::vector<float> value;

    int64_t rows() const { return static_cast<int64_t>(begin.size()) - 1; }
    // What is added lies in the row that endRow() ends.
    void add(int64_t at, float number) {
        column.push_back(static_cast<int32_t>(at));
        value.push_back(number);
    }
    void endRow() { begin.push_back(static_cast<int32_t>(column.size())); }
};

}  // namespace doppel
