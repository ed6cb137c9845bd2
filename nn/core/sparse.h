// Matrices of few numbers, in compressed sparse rows.
#pragma once

#include <cstdint>
#include <span>
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
    // [rows,width] of x [columns,width].
    std::vector<float> times(std::span<const float> x, size_t width) const {
        std::vector<float> y(static_cast<size_t>(rows()) * width);
        for (size_t row = 0; row + 1 < begin.size(); ++row)
            for (auto i = static_cast<size_t>(begin[row]); i < static_cast<size_t>(begin[row + 1]);
                 ++i)
                for (size_t k = 0; k < width; ++k)
                    y[row * width + k] += value[i] * x[static_cast<size_t>(column[i]) * width + k];
        return y;
    }
};

}  // namespace doppel
