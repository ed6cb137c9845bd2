// The op registry, its refusals, and that no op is left without a test.
#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>

#include "tests/op_test.h"

namespace doppel {
namespace {

TEST(OpRegistry, EveryOpHasACase) {
    std::string sources;
    for (const auto& entry : std::filesystem::directory_iterator(DOPPEL_SOURCE_DIR "/tests")) {
        if (entry.path().extension() != ".cpp" || entry.path().filename() == "test_op.cpp")
            continue;
        std::stringstream text;
        text << std::ifstream(entry.path()).rdbuf();
        sources += text.str();
    }
    EXPECT_FALSE(Op::all().empty());
    for (const Op* op : Op::all())
        EXPECT_TRUE(std::regex_search(sources,
                                      std::regex("check[A-Za-z0-9]*\\(\\s*\"" + op->name() + "\"")))
            << "no test calls checkOp(\"" << op->name() << "\", …) or a helper of its own";
}

TEST(OpRegistry, RefusesWhatDoesNotFit) {
    const Op* op = Op::find("leaky_relu");
    ASSERT_NE(op, nullptr);
    EXPECT_EQ(Op::find("no_such_op"), nullptr);
    Npz in;
    expectInputError([&] { op->run(testDevice(), in, {}); }, "input x is missing");
    std::vector<float> x{1, -2, 3};
    in.set("x", Array::f32({3}, x));
    expectInputError([&] { op->run(testDevice(), in, {}); }, "attr_slope is missing");
    in.set("attr_slope", Array::scalarF32(NAN));
    expectInputError([&] { op->run(testDevice(), in, {}); }, "must be finite");
    in.set("attr_slope", Array::scalarF32(0.5f));
    in.set("grad_y", Array::f32({1}, std::vector<float>{1}));
    expectInputError([&] { op->run(testDevice(), in, {}); }, "expected the shape of y [3]");
    in.set("grad_y", Array::f32({3}, std::vector<float>{1, 1, 1}));
    in.set("nonsense", Array::f32({1}, std::vector<float>{1}));
    expectInputError([&] { op->run(testDevice(), in, {}); }, "nonsense");
}

}  // namespace
}  // namespace doppel
