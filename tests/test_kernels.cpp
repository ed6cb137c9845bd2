// Every entry of every shader ran and every op was checked, by the tests of ops together: each of
// these programs leaves a list of what it covered (op_test.cpp), and CTest runs this one last.
#include <filesystem>
#include <fstream>
#include <map>
#include <set>

#include "engine/cooperative_matrix.h"
#include "engine/kernel.h"
#include "tests/files.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

namespace fs = std::filesystem;

struct Coverage {
    std::set<std::string> lines;
    // Tests without a list of this build: they failed, or ran in part, or before they were built
    // last, or not at all.
    std::vector<std::string> missing;
};

// folder/tests holds lines "TEST PROGRAM"; folder/TEST.txt is a test's list, and stands for the
// program if it is not older.
Coverage readCoverage(const fs::path& folder, const fs::path& programs) {
    Coverage coverage;
    std::ifstream tests(folder / "tests");
    for (std::string test, program; tests >> test >> program;) {
        const fs::path list = folder / (test + ".txt");
        if (!fs::exists(list) ||
            fs::last_write_time(list) < fs::last_write_time(programs / program)) {
            coverage.missing.push_back(test);
            continue;
        }
        std::ifstream file(list);
        for (std::string line; std::getline(file, line);) coverage.lines.insert(line);
    }
    return coverage;
}

// Whether the tests' device can run a kernel: some multiply matrices at once, some read texels
// beside addresses.
bool canRun(const DeviceInfo& info, const ShaderTableRow& row) {
    if (usesCooperativeMatrices(row.addresses) && !info.halfMatrices) return false;
    const bool forCpu = std::string_view(row.name).ends_with("@cpu");
    return info.cpu || !(forCpu || reflect(row.descriptors).texels);
}

// What is not covered, a sentence each. A kernel counts in either flavour, for there is one source;
// which flavour an op takes on which device is the op's choice.
std::vector<std::string> uncovered(const std::set<std::string>& lines, const DeviceInfo& info) {
    std::vector<std::string> sentences;
    for (const ShaderTableRow& row : shaderTable()) {
        const std::string kernel = row.name;
        if (canRun(info, row) && !lines.contains("kernel " + kernel + " addresses") &&
            !lines.contains("kernel " + kernel + " descriptors"))
            sentences.push_back("no test of an op runs the kernel " + kernel);
    }
    for (const Op* op : Op::all())
        if (!lines.contains("op " + op->name()))
            sentences.push_back("no test calls checkOp(\"" + op->name() + "\", ...)");
    return sentences;
}

std::string joined(const std::vector<std::string>& sentences, const char* separator) {
    std::string text;
    for (const std::string& sentence : sentences)
        text += (text.empty() ? "" : separator) + sentence;
    return text;
}

TEST(Kernels, EveryEntryRanAndEveryOpWasChecked) {
    const char* folder = std::getenv("DOPPEL_KERNEL_LOGS");
    if (!folder) GTEST_SKIP() << "DOPPEL_KERNEL_LOGS names no folder; run this test with ctest";
    Coverage coverage = readCoverage(folder, fs::read_symlink("/proc/self/exe").parent_path());
    if (!coverage.missing.empty())
        GTEST_SKIP() << "these tests have not passed since they were built: "
                     << joined(coverage.missing, ", ");
    ASSERT_FALSE(shaderTable().empty());
    ASSERT_FALSE(Op::all().empty());
    EXPECT_EQ(joined(uncovered(coverage.lines, testDevice().info()), "\n"), "");
}

TEST(Kernels, WhatIsMissingIsNamed) {
    std::set<std::string> lines;
    for (const ShaderTableRow& row : shaderTable())
        lines.insert("kernel " + std::string(row.name) + " addresses");
    for (const Op* op : Op::all()) lines.insert("op " + op->name());
    const DeviceInfo any{.halfMatrices = MatrixShape{}, .cpu = true};
    EXPECT_TRUE(uncovered(lines, any).empty());
    const std::string kernel = shaderTable().front().name, op = Op::all().front()->name();
    lines.erase("kernel " + kernel + " addresses");
    lines.erase("op " + op);
    EXPECT_EQ(uncovered(lines, any),
              (std::vector<std::string>{"no test of an op runs the kernel " + kernel,
                                        "no test calls checkOp(\"" + op + "\", ...)"}));
}

TEST(Kernels, AListThatIsMissingOrOldDoesNotCount) {
    test::Folder folder;
    auto write = [&](const char* name, const char* text) { std::ofstream(folder / name) << text; };
    auto age = [&](const char* name, int hours) {
        fs::last_write_time(folder / name,
                            fs::file_time_type::clock::time_point{} + std::chrono::hours(hours));
    };
    write("tests", "test_a test_a\ntest_a_descriptors test_a\ntest_b test_b\n");
    write("test_a", "");
    write("test_b", "");
    write("test_a.txt", "op add\nkernel mesh/tail.append addresses\n");
    write("test_b.txt", "op multiply\n");
    age("test_a", 1), age("test_b", 1), age("test_a.txt", 1), age("test_b.txt", 0);
    Coverage coverage = readCoverage(folder.path(), folder.path());
    EXPECT_EQ(coverage.missing, (std::vector<std::string>{"test_a_descriptors", "test_b"}));
    EXPECT_EQ(coverage.lines,
              (std::set<std::string>{"kernel mesh/tail.append addresses", "op add"}));
}

}  // namespace
}  // namespace doppel
