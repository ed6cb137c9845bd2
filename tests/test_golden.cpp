// Golden cases: tests/golden/OP/CASE.npz holds inputs, attributes, upstream gradients, and
// expect_NAME for every array that must come out. Dropping a file there adds a test.
#include <algorithm>
#include <filesystem>

#include "tests/op_test.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> goldenFiles() {
    std::vector<fs::path> files;
    for (const auto& entry : fs::recursive_directory_iterator(DOPPEL_SOURCE_DIR "/tests/golden"))
        if (entry.path().extension() == ".npz") files.push_back(entry.path());
    std::ranges::sort(files);
    return files;
}

class Golden : public testing::TestWithParam<fs::path> {};

void compare(const fs::path& file, Precision precision, double leastTolerance) {
    const Op* op = Op::find(file.parent_path().filename().string());
    ASSERT_NE(op, nullptr) << "the folder is named after an op";
    Npz in = readNpz(file);
    Npz out = op->run(testDevice(precision), in, {.reuseMemory = false, .poison = true});
    double tolerance =
        std::max(leastTolerance, in.has("tol_rel") ? in.at("tol_rel").scalar() : 1e-4);
    int compared = 0;
    for (const auto& [name, array] : in) {
        if (!name.starts_with("expect_")) continue;
        std::string output = name.substr(7);
        ASSERT_TRUE(out.has(output)) << output;
        ASSERT_EQ(out.at(output).shape, array.shape) << output;
        EXPECT_LE(relativeError(out.at(output).toF64(), array.toF64(), 1e-12), tolerance) << output;
        ++compared;
    }
    EXPECT_GT(compared, 0) << "the file expects something";
}

TEST_P(Golden, Matches) { compare(GetParam(), Precision::Single, 0); }

// The same cases with inputs in halves. Only products are: everything else must come out as before.
TEST_P(Golden, MatchesWithMixedPrecision) {
    std::string op = GetParam().parent_path().filename().string();
    if (op != "matmul" && op != "linear" && op != "graph_conv" && !op.starts_with("conv"))
        GTEST_SKIP() << op << " is no product of matrices";
    compare(GetParam(), Precision::Mixed, 4e-3);
}

std::string caseName(const testing::TestParamInfo<fs::path>& file) {
    std::string name =
        file.param.parent_path().filename().string() + "_" + file.param.stem().string();
    std::ranges::replace_if(
        name, [](char c) { return !std::isalnum(static_cast<unsigned char>(c)); }, '_');
    return name;
}

GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(Golden);
INSTANTIATE_TEST_SUITE_P(Files, Golden, testing::ValuesIn(goldenFiles()), caseName);

}  // namespace
}  // namespace doppel
