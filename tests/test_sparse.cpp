// Products with matrices of few numbers.
#include <vector>

#include "tests/op_test.h"

namespace doppel::test {
namespace {

TEST(SparseProduct, AgainstPlainLoop) {
    for (const int64_t rows : {1, 5, 127})
        for (const int64_t channels : {1, 3, 4}) {
            constexpr int64_t kColumns = 66;
            // Rows of none and of up to six numbers; some columns are in many rows, some twice in
            // one, some in none.
            std::vector<int32_t> begin{0}, column;
            for (int64_t row = 0; row < rows; ++row) {
                for (int64_t n = 0; n < (row + 1) % 7; ++n)
                    column.push_back(
                        static_cast<int32_t>(n % 4 == 1 ? 7 : (row * row + n) % (kColumns - 3)));
                begin.push_back(static_cast<int32_t>(column.size()));
            }
            const auto count = static_cast<int64_t>(column.size());
            checkOp(
                "sparse_product",
                {.inputs = {{"x", random({kColumns, channels}, 1)}, {"value", random({count}, 2)}},
                 .integers = {{"begin", indices({rows + 1}, begin)},
                              {"column", indices({count}, column)}},
                 .reference = [&](const Values& in) -> Values {
                     Value y{{rows, channels}, {}};
                     y.data.resize(size_t(rows * channels));
                     const auto C = size_t(channels);
                     for (size_t row = 0; row < size_t(rows); ++row)
                         for (auto n = size_t(begin[row]); n < size_t(begin[row + 1]); ++n)
                             for (size_t c = 0; c < C; ++c)
                                 y.data[C * row + c] += in.at("value").data[n] *
                                                        in.at("x").data[C * size_t(column[n]) + c];
                     return {{"y", y}};
                 }});
        }
}

TEST(SparseProduct, RefusesWhatDoesNotFit) {
    const Op* op = Op::find("sparse_product");
    ASSERT_NE(op, nullptr);
    const auto run = [&](std::vector<int32_t> begin, int32_t column) {
        Npz arrays;
        arrays.set("x", Array::f64({2, 3}, std::vector<double>(6)));
        arrays.set("value", Array::f64({1}, std::vector<double>{1}));
        arrays.set("begin", Array::i32({static_cast<int64_t>(begin.size())}, begin));
        arrays.set("column", Array::i32({1}, std::vector<int32_t>{column}));
        op->run(testDevice(), arrays, {});
    };
    run({0, 0, 1}, 1);
    expectInputError([&] { run({0}, 0); }, "begin: expected numbers that rise from 0 to 1");
    expectInputError([&] { run({0, 2, 1}, 0); }, "begin: expected numbers that rise from 0 to 1");
    expectInputError([&] { run({0, 0}, 0); }, "begin: expected numbers that rise from 0 to 1");
    expectInputError([&] { run({0, 1}, 2); }, "column has 2; expected 0 to 1");
}

}  // namespace
}  // namespace doppel::test
