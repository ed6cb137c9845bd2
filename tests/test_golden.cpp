// Golden cases: tests/golden/OP/CASE.npz holds inputs, attributes, upstream gradients, and
// expect_NAME for every array that must come out. Dropping a file there adds a test.
#include <algorithm>
#include <filesystem>

#include "tests/files.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

const fs::path kGolden = test::sourceFolder() / "tests/golden";

std::vector<fs::path> goldenFiles() {
    std::vector<fs::path> files;
    for (const auto& entry : fs::recursive_directory_iterator(kGolden))
        if (entry.path().extension() == ".npz") files.push_back(entry.path());
    std::ranges::sort(files);
    return files;
}

// What keeps files of a folder from being cases, a sentence each.
std::vector<std::string> goldenProblems(const fs::path& folder) {
    std::vector<std::string> problems;
    size_t files = 0;
    for (const auto& entry : fs::recursive_directory_iterator(folder)) {
        const fs::path path = fs::relative(entry.path(), folder);
        if (entry.is_directory()) {
            if (fs::is_empty(entry)) problems.push_back(path.string() + " holds no case");
            continue;
        }
        if (path.filename() == ".gitkeep") continue;
        ++files;
        const std::string op = path.parent_path().string();
        if (path.extension() != ".npz")
            problems.push_back(path.string() + " is no .npz file");
        else if (!Op::find(op))
            problems.push_back(path.string() + ": there is no op \"" + op + "\"");
    }
    if (files == 0) problems.push_back("there are no golden files");
    std::ranges::sort(problems);
    return problems;
}

TEST(GoldenFolder, HoldsCasesOfOps) {
    EXPECT_EQ(goldenProblems(kGolden), std::vector<std::string>{});
}

TEST(GoldenFolder, RefusesWhatIsNoCase) {
    test::Folder folder;
    EXPECT_EQ(goldenProblems(folder.path()), std::vector<std::string>{"there are no golden files"});
    for (const char* name : {"add", "add/deep", "no_such_op", "tanh"})
        fs::create_directory(folder / name);
    for (const char* name :
         {"a.npz", "add/b.npz", "add/deep/c.npz", "add/d.txt", "no_such_op/e.npz"})
        folder.write(name, "");
    EXPECT_EQ(goldenProblems(folder.path()),
              (std::vector<std::string>{"a.npz: there is no op \"\"", "add/d.txt is no .npz file",
                                        "add/deep/c.npz: there is no op \"add/deep\"",
                                        "no_such_op/e.npz: there is no op \"no_such_op\"",
                                        "tanh holds no case"}));
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

INSTANTIATE_TEST_SUITE_P(Files, Golden, testing::ValuesIn(goldenFiles()), caseName);

}  // namespace
}  // namespace doppel
