// TensorFlow Lite files: what a small one holds, what networks make of it, and damage refused.
#include "engine/io/tflite.h"

#include <flatbuffers/flatbuffers.h>
#include <gtest/gtest.h>

#include <random>

#include "engine/error.h"
#include "nn/nets/tflite_net.h"
#include "tests/files.h"
#include "tests/op_test.h"

namespace doppel {
namespace {

namespace fb = flatbuffers;
using test::messageOf;
using Table = fb::Offset<fb::Table>;

fb::voffset_t slot(int field) { return fb::voffset_t(4 + 2 * field); }

// Writes tables field by field.
class Writer {
public:
    fb::FlatBufferBuilder builder;

    Table table(const std::vector<std::pair<int, fb::Offset<void>>>& offsets,
                const std::vector<std::pair<int, int32_t>>& numbers = {},
                const std::vector<std::pair<int, int8_t>>& bytes = {}) {
        const auto start = builder.StartTable();
        for (const auto& [field, offset] : offsets) builder.AddOffset(slot(field), offset);
        for (const auto& [field, value] : numbers) builder.AddElement(slot(field), value, 0);
        for (const auto& [field, value] : bytes) builder.AddElement<int8_t>(slot(field), value, 0);
        return Table(builder.EndTable(start));
    }
    template <typename T>
    fb::Offset<void> vector(const std::vector<T>& values) {
        return builder.CreateVector(values).Union();
    }
    template <typename T>
    Table buffer(const std::vector<T>& values) {
        const auto* bytes = reinterpret_cast<const uint8_t*>(values.data());
        const auto data = builder.CreateVector(bytes, values.size() * sizeof(T));
        return table({{0, data.Union()}});
    }
    Table tensor(const std::vector<int32_t>& shape, int8_t type, int32_t buffer,
                 fb::Offset<void> sparsity = {}) {
        const auto sides = vector(shape);
        const auto name = builder.CreateString("tensor").Union();
        std::vector<std::pair<int, fb::Offset<void>>> offsets{{0, sides}, {3, name}};
        if (!sparsity.IsNull()) offsets.emplace_back(6, sparsity);
        return table(offsets, {{2, buffer}}, {{1, type}});
    }
    Table op(int32_t code, const std::vector<int32_t>& inputs, int32_t output,
             fb::Offset<void> options = {}) {
        const auto from = vector(inputs), to = vector(std::vector<int32_t>{output});
        std::vector<std::pair<int, fb::Offset<void>>> offsets{{1, from}, {2, to}};
        if (!options.IsNull()) offsets.emplace_back(4, options);
        return table(offsets, {{0, code}});
    }
};

// y[1,2,2,3] = ReLU6(x[1,2,2,2] W + b) + x W2, W of half precision and W2 sparse:
// W = [[1, 2], [0, -1], [.5, 0]], b = [0, 1, 0], W2 = [[0, 3], [0, 0], [4, 0]].
std::vector<uint8_t> smallModel(int32_t convSide = 1, int8_t activation = 3) {
    Writer w;
    const uint16_t one = 0x3C00, two = 0x4000, half = 0x3800, three = 0x4200, four = 0x4400;
    const std::vector<Table> buffers{
        w.table({}), w.buffer(std::vector<uint16_t>{one, two, 0, uint16_t(one | 0x8000), half, 0}),
        w.buffer(std::vector<float>{0, 1, 0}), w.buffer(std::vector<uint16_t>{three, four}),
        w.buffer(std::vector<float>{0, 0, 0})};
    std::vector<fb::Offset<void>> dimensions;
    for (int32_t side : {3, 1, 1}) dimensions.push_back(w.table({}, {{1, side}}).Union());
    const auto segments = w.table({{0, w.vector(std::vector<uint8_t>{0, 1, 1, 2})}}).Union();
    const auto columns = w.table({{0, w.vector(std::vector<uint8_t>{1, 0})}}).Union();
    dimensions.push_back(
        w.table({{3, segments}, {5, columns}}, {}, {{0, 1}, {2, 3}, {4, 3}}).Union());
    const auto order = w.vector(std::vector<int32_t>{0, 1, 2, 3});
    const auto metadata = w.builder.CreateVector(dimensions).Union();
    const auto sparsity = w.table({{0, order}, {2, metadata}}).Union();
    const std::vector<int32_t> kernel{3, 1, convSide, 2};
    const std::vector<Table> tensors{w.tensor({1, 2, 2, 2}, 0, 0), w.tensor(kernel, 1, 1),
                                     w.tensor(kernel, 0, 0),       w.tensor({3}, 0, 2),
                                     w.tensor({1, 2, 2, 3}, 0, 0), w.tensor(kernel, 1, 3, sparsity),
                                     w.tensor(kernel, 1, 0),       w.tensor(kernel, 0, 0),
                                     w.tensor({1, 2, 2, 3}, 0, 0), w.tensor({1, 2, 2, 3}, 0, 0),
                                     w.tensor({3}, 0, 4)};
    const auto options = [&](int8_t act) {
        return w.table({}, {{1, 1}, {2, 1}}, {{3, act}}).Union();
    };
    std::vector<Table> operators;
    operators.push_back(w.op(1, {1}, 2));
    operators.push_back(w.op(0, {0, 2, 3}, 4, options(activation)));
    operators.push_back(w.op(2, {5}, 6));
    operators.push_back(w.op(1, {6}, 7));
    operators.push_back(w.op(0, {0, 7, 10}, 8, options(0)));
    operators.push_back(w.op(3, {4, 8}, 9, w.table({}).Union()));
    std::vector<Table> codes;
    for (int32_t code : {3, 6, 124, 0}) codes.push_back(w.table({}, {{3, code}}));
    const auto allTensors = w.builder.CreateVector(tensors).Union();
    const auto inputs = w.vector(std::vector<int32_t>{0}),
               outputs = w.vector(std::vector<int32_t>{9});
    const auto allOperators = w.builder.CreateVector(operators).Union();
    const std::vector<Table> graphs{
        w.table({{0, allTensors}, {1, inputs}, {2, outputs}, {3, allOperators}})};
    const auto allGraphs = w.builder.CreateVector(graphs).Union();
    const auto allCodes = w.builder.CreateVector(codes).Union();
    const auto allBuffers = w.builder.CreateVector(buffers).Union();
    w.builder.Finish(w.table({{1, allCodes}, {2, allGraphs}, {4, allBuffers}}, {{0, 3}}), "TFL3");
    return {w.builder.GetBufferPointer(), w.builder.GetBufferPointer() + w.builder.GetSize()};
}

TEST(Tflite, ConstantsAreFolded) {
    const TfliteModel model = tfliteFromBytes(smallModel(), "small");
    ASSERT_EQ(model.operators.size(), 3u);
    EXPECT_EQ(model.operators[0].kind, TfliteKind::Conv);
    EXPECT_TRUE(model.operators[0].relu6);
    EXPECT_TRUE(model.operators[0].same);
    EXPECT_EQ(model.operators[2].kind, TfliteKind::Add);
    EXPECT_EQ(model.tensors[2].values, (std::vector<float>{1, 2, 0, -1, .5f, 0}));
    EXPECT_EQ(model.tensors[7].values, (std::vector<float>{0, 3, 0, 0, 4, 0}));
    EXPECT_EQ(model.inputs, std::vector<int>{0});
}

TEST(Tflite, TheNetComputesWhatTheFileSays) {
    const TfliteModel model = tfliteFromBytes(smallModel(), "small");
    Graph graph(testDevice());
    const Tensor x = graph.input({1, 2, 2, 2});
    const auto outputs = tfliteNet(graph, model, x);
    ASSERT_EQ(outputs.size(), 1u);
    EXPECT_EQ(outputs[0].shape, (Shape{1, 3, 2, 2}));
    graph.output(outputs[0]);
    graph.compile({.poison = true});
    const std::vector<float> values{1, 2, -3, 4, 5, .5f, .25f, 0};  // channels first
    graph.write(x, values);
    graph.run();
    const std::vector<float> y = graph.read(outputs[0]);
    for (size_t p = 0; p < 4; ++p) {
        const float a = values[p], b = values[4 + p];
        const auto relu6 = [](float v) { return std::min(std::max(v, 0.f), 6.f); };
        EXPECT_NEAR(y[p], relu6(a + 2 * b) + 3 * b, 1e-5);
        EXPECT_NEAR(y[4 + p], relu6(1 - b), 1e-5);
        EXPECT_NEAR(y[8 + p], relu6(.5f * a) + 4 * a, 1e-5);
    }
}

// A convolution 3x3 of stride 2, padded SAME, over an even picture (one more row of zeros below and
// on the right, none above), and a PReLU, by plain loops.
TEST(Tflite, UnevenBordersAndSlopesBelowZero) {
    constexpr int kIn = 6, kC = 2, kO = 3, kOut = 3;
    std::mt19937 random(7);
    std::uniform_real_distribution<float> uniform(-1, 1);
    const auto numbers = [&](size_t count) {
        std::vector<float> values(count);
        for (float& v : values) v = uniform(random);
        return values;
    };
    TfliteModel model{.file = "made here"};
    const auto tensor = [&](std::vector<int64_t> shape, std::vector<float> values = {}) {
        model.tensors.push_back({"", std::move(shape), std::move(values), {}});
        return int(model.tensors.size()) - 1;
    };
    const std::vector<float> weight = numbers(kO * 9 * kC), bias = numbers(kO), slope = numbers(kO);
    const int x = tensor({1, kIn, kIn, kC}), w = tensor({kO, 3, 3, kC}, weight),
              b = tensor({kO}, bias), y = tensor({1, kOut, kOut, kO}),
              a = tensor({1, 1, kO}, slope), z = tensor({1, kOut, kOut, kO});
    model.operators = {{.kind = TfliteKind::Conv,
                        .inputs = {x, w, b},
                        .output = y,
                        .same = true,
                        .stride = {2, 2}},
                       {.kind = TfliteKind::Prelu, .inputs = {y, a}, .output = z}};
    model.inputs = {x};
    model.outputs = {z};

    Graph graph(testDevice());
    const Tensor input = graph.input({1, kC, kIn, kIn});
    const Tensor output = tfliteNet(graph, model, input)[0];
    graph.output(output);
    graph.compile({.poison = true});
    const std::vector<float> values = numbers(kC * kIn * kIn);
    graph.write(input, values);
    graph.run();
    const std::vector<float> got = graph.read(output);
    ASSERT_EQ(got.size(), size_t(kO * kOut * kOut));
    int below = 0;
    for (int o = 0; o < kO; ++o)
        for (int r = 0; r < kOut; ++r)
            for (int c = 0; c < kOut; ++c) {
                double sum = double(bias[size_t(o)]);
                for (int i = 0; i < 3; ++i)
                    for (int j = 0; j < 3; ++j)
                        for (int k = 0; k < kC; ++k) {
                            const int row = 2 * r + i, column = 2 * c + j;
                            if (row >= kIn || column >= kIn) continue;
                            sum += double(weight[size_t(((o * 3 + i) * 3 + j) * kC + k)]) *
                                   double(values[size_t((k * kIn + row) * kIn + column)]);
                        }
                below += sum < 0;
                const double want = sum > 0 ? sum : double(slope[size_t(o)]) * sum;
                EXPECT_NEAR(got[size_t((o * kOut + r) * kOut + c)], want, 1e-5);
            }
    EXPECT_GT(below, 5);
    EXPECT_LT(below, 22);
}

TEST(Tflite, RefusalsNameTheFile) {
    const auto refusal = [](std::vector<uint8_t> bytes) {
        return messageOf<InputError>([&] { tfliteFromBytes(bytes, "small"); });
    };
    EXPECT_EQ(refusal({}), "small: expected a TensorFlow Lite model (TFL3), found something else");
    EXPECT_EQ(refusal(smallModel(1, 1)),
              "small: expected operators followed by ReLU6 or nothing, found activation 1");
    EXPECT_NE(refusal(smallModel(2)).find("small: expected 24 bytes for the constant tensor"),
              std::string::npos);
}

TEST(Tflite, DamageIsRefusedNotFollowed) {
    const std::vector<uint8_t> whole = smallModel();
    const auto read = [](const std::vector<uint8_t>& bytes) {
        try {
            const TfliteModel model = tfliteFromBytes(bytes, "small");
            Graph graph(testDevice());
            if (model.inputs.size() == 1) tfliteNet(graph, model, graph.input({1, 2, 2, 2}));
        } catch (const InputError&) {
        }
    };
    for (size_t size = 0; size < whole.size(); ++size)
        read({whole.begin(), whole.begin() + std::ptrdiff_t(size)});
    std::mt19937 random(5);
    for (int round = 0; round < 3000; ++round) {
        std::vector<uint8_t> damaged = whole;
        for (int i = 0; i < 1 + round % 4; ++i)
            damaged[random() % damaged.size()] = uint8_t(round % 2 ? random() : random() % 5);
        read(damaged);
    }
}

}  // namespace
}  // namespace doppel
