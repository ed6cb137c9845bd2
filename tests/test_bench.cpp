// doppel-bench as a program: its cases, its JSON, and that it can be carried alone.
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <string>

#include "nn/core/op.h"

namespace doppel {
namespace {

struct Outcome {
    int status = -1;
    std::string out;
};

Outcome shell(const std::string& command) {
    Outcome outcome;
    FILE* pipe = popen(command.c_str(), "r");
    if (!pipe) return outcome;
    std::array<char, 4096> buffer;
    while (size_t count = std::fread(buffer.data(), 1, buffer.size(), pipe))
        outcome.out.append(buffer.data(), count);
    int status = pclose(pipe);
    outcome.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    return outcome;
}

// Beside this test.
std::string program() {
    return (std::filesystem::read_symlink("/proc/self/exe").parent_path() / "doppel-bench")
        .string();
}

Outcome bench(const std::string& arguments) {
    return shell(fmt::format("'{}' {} 2>/dev/null", program(), arguments));
}

std::set<std::string> caseNames() {
    Outcome listed = bench("--benchmark_list_tests");
    EXPECT_EQ(listed.status, 0);
    std::set<std::string> names;
    std::istringstream lines(listed.out);
    for (std::string line; std::getline(lines, line);)
        names.insert(line.substr(0, line.rfind("/manual_time")));
    return names;
}

TEST(Bench, HasStepsInferenceAndCeilings) {
    std::set<std::string> names = caseNames();
    for (const char* name : {"mesh_step", "texture_step", "gan_step", "inference",
                             "inference_refined", "ceiling_fma", "ceiling_copy"})
        EXPECT_TRUE(names.contains(name)) << name;
}

TEST(Bench, HasEveryOpBothWays) {
    std::set<std::string> names = caseNames();
    auto has = [&](const std::string& op, const std::string& way) {
        return std::ranges::any_of(names, [&](const std::string& name) {
            return name.starts_with("op/" + op + "/") && name.ends_with("/" + way);
        });
    };
    for (const Op* op : Op::all()) {
        EXPECT_TRUE(has(op->name(), "forward")) << op->name();
        if (!op->declaration().differentiable.empty()) {
            EXPECT_TRUE(has(op->name(), "backward")) << op->name();
        }
    }
}

TEST(Bench, GrowsFacesPixelsVerticesAndBatch) {
    std::set<std::string> names = caseNames();
    for (const char* raster : {"soft_silhouette", "textured_render", "visibility_map"})
        for (const char* faces : {"7000", "70000", "700000"})
            for (const char* pixels : {"256", "512", "1024", "2048"})
                EXPECT_TRUE(names.contains(std::string("grow/") + raster + "/faces:" + faces +
                                           "/pixels:" + pixels));
    EXPECT_TRUE(names.contains("grow/mesh_step/vertices:128000"));
    EXPECT_TRUE(names.contains("grow/texture_step/batch:8"));
}

TEST(Bench, PrintsGoogleBenchmarksJson) {
    Outcome ran = bench(
        "--json --benchmark_min_time=0.001 "
        "--benchmark_filter='^op/(linear/offset|laplacian_loss)/|ceiling_fma'");
    ASSERT_EQ(ran.status, 0);
    nlohmann::json result = nlohmann::json::parse(ran.out);
    EXPECT_FALSE(result["context"]["device"].get<std::string>().empty());
    double ceiling = std::stod(result["context"]["ceiling_fma_GFLOP/s"].get<std::string>());
    EXPECT_GT(ceiling, 0);
    ASSERT_EQ(result["benchmarks"].size(), 5u);
    for (const nlohmann::json& row : result["benchmarks"]) {
        std::string name = row["name"];
        EXPECT_GT(row["real_time"].get<double>(), 0) << name;
        EXPECT_EQ(row["time_unit"], "ms");
        EXPECT_GE(row["wall_ms"].get<double>(), row["real_time"].get<double>()) << name;
        EXPECT_GT(row["%floor"].get<double>(), 0) << name;
        if (name.starts_with("op/linear/offset")) {
            // 2 * 7999 * 132 * 3 forward, twice as much backward.
            double flops = name.find("backward") == std::string::npos ? 6335208.0 : 12670416.0;
            // The two are rounded, so they differ by a part of themselves.
            const double rate = flops * 1e-6 / row["real_time"].get<double>();
            EXPECT_NEAR(row["GFLOP/s"].get<double>(), rate, 1e-3 * rate);
            EXPECT_NEAR(row["%fma"].get<double>(), 100 * row["GFLOP/s"].get<double>() / ceiling,
                        .2 + 1e-2 * row["%fma"].get<double>());
        }
    }
}

TEST(Bench, ReplaysWhatStdinNames) {
    Outcome ran = shell("printf 'op/relu/4M/forward\nop/relu/4M/forward\n' | '" + program() +
                        "' --replay 2>/dev/null");
    ASSERT_EQ(ran.status, 0);
    std::istringstream lines(ran.out);
    double first = 0, second = 0;
    lines >> first >> second;
    EXPECT_GT(first, 0);
    EXPECT_GT(second, 0);
    EXPECT_EQ(shell("echo op/none | '" + program() + "' --replay 2>/dev/null").status, 2);
}

TEST(Bench, SaysWhichOpsTakeTheTime) {
    Outcome ran = shell("echo op/relu/4M/forward | '" + program() + "' --profile 2>/dev/null");
    ASSERT_EQ(ran.status, 0);
    std::istringstream lines(ran.out);
    std::string title, line;
    std::getline(lines, title);
    EXPECT_TRUE(title.starts_with("op/relu/4M/forward ")) << ran.out;
    double sum = 0, all = 0;
    while (std::getline(lines, line) && !line.empty()) {
        std::istringstream words(line);
        std::string op;
        double count, mib, gflop, milliseconds;
        ASSERT_TRUE(words >> op >> count >> mib >> gflop >> milliseconds) << line;
        (op == "all" ? all : sum) += milliseconds;
    }
    EXPECT_GT(sum, 0);
    EXPECT_NEAR(all, sum, .01);
}

TEST(Bench, SaysWhatIsWrong) {
    EXPECT_EQ(bench("--no-such-flag").status, 2);
    EXPECT_EQ(bench("--device").status, 2);
    EXPECT_EQ(bench("--device 'no such device'").status, 1);
}

// The Vulkan loader and what every Linux has.
TEST(Bench, CanBeCarriedAlone) {
    Outcome linked = shell(fmt::format("ldd '{}' 2>&1", program()));
    if (linked.status != 0) GTEST_SKIP() << "no ldd, or a static program: " << linked.out;
    if (linked.out.find("libbenchmark") != std::string::npos)
        GTEST_SKIP() << "built without a static Google Benchmark; scripts/setup fetches it";
    if (linked.out.find("libasan") != std::string::npos) GTEST_SKIP() << "a sanitized build";
    std::istringstream lines(linked.out);
    for (std::string line; std::getline(lines, line);) {
        bool expected = false;
        for (const char* library : {"linux-vdso", "linux-gate", "libvulkan.", "libc.", "libm.",
                                    "libpthread.", "libdl.", "librt.", "ld-linux"})
            expected |= line.find(library) != std::string::npos;
        EXPECT_TRUE(expected) << line;
    }
}

}  // namespace
}  // namespace doppel
