// Weights of other programs: what PyTorch has written is read, and nothing in a file is believed or
// run. tests/weights/make.py made the files.
#include "engine/io/weights.h"

#include <gtest/gtest.h>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/io/pickle.h"
#include "tests/files.h"

namespace doppel {
namespace {

using test::Folder;
using test::messageOf;

const std::filesystem::path kFolder = test::sourceFolder() / "tests/weights";

void expectTensor(const Safetensors& file, const char* name, std::vector<int64_t> shape,
                  std::vector<float> values) {
    EXPECT_EQ(file.at(name).shape, shape) << name;
    EXPECT_EQ(file.at(name).values, values) << name;
}

TEST(Weights, ReadsWhatPyTorchWrites) {
    for (const char* name : {"state_dict.pt", "legacy.pt"}) {
        SCOPED_TRACE(name);
        Safetensors file = readWeights(kFolder / name);
        std::vector<float> ramp(24), transposed(24);
        for (size_t i = 0; i < 24; ++i) {
            ramp[i] = float(i) * .5f - 1;
            transposed[i] = float(i % 4 * 6 + i / 4);
        }
        expectTensor(file, "layer.weight", {2, 3, 4}, ramp);
        expectTensor(file, "layer.bias", {2}, {1.5f, -2});
        expectTensor(file, "transposed", {6, 4}, transposed);
        expectTensor(file, "part", {2, 3}, {8, 9, 10, 14, 15, 16});
        expectTensor(file, "half", {2}, {.5f, -65504});
        expectTensor(file, "brain", {2}, {1.5f, -3});
        expectTensor(file, "double", {2}, {1e-3f, 2});
        expectTensor(file, "scalar", {}, {7});
        expectTensor(file, "empty", {0, 4}, {});
        expectTensor(file, "parameter", {1}, {4});
        EXPECT_EQ(file.tensors.size(), 10u) << "integers are left out";
    }
    Safetensors checkpoint = readWeights(kFolder / "checkpoint.pt");
    expectTensor(checkpoint, "w", {2}, {1, 2});
}

TEST(Weights, ReadsSafetensorsWithCounts) {
    const std::string header = R"({"n":{"dtype":"I64","shape":[],"data_offsets":[0,8]},)"
                               R"("w":{"dtype":"F32","shape":[1],"data_offsets":[8,12]}})";
    std::vector<uint8_t> bytes(8 + header.size() + 12);
    bytes[0] = static_cast<uint8_t>(header.size());
    std::copy(header.begin(), header.end(), bytes.begin() + 8);
    Safetensors file = weightsFromBytes(bytes, "x.safetensors");
    EXPECT_EQ(file.tensors.size(), 1u);
    expectTensor(file, "w", {1}, {0});
    EXPECT_NE(messageOf<InputError>([&] { safetensorsFromBytes(bytes, "x"); }).find("type I64"),
              std::string::npos);
}

TEST(Weights, RefusesLies) {
    const std::pair<const char*, const char*> cases[] = {
        {"code.pt", "refers to code ("},
        {"missing_storage.pt", "layer.weight: its storage 0 is missing in the file"},
        {"short_storage.pt", "layer.weight: expected 96 bytes in its storage, found 8"},
        {"no_pickle.pt", "expected a PyTorch file, found a zip archive without data.pkl"},
        {"big_endian.pt", "byte order"},
        {"torchscript.pt", "found TorchScript"},
        {"beyond_storage.pt", "a: its elements reach to 24 of a storage of 24"},
        {"overflow.pt", "a: a tensor of impossible shape"},
        {"negative.pt", "a: a tensor of impossible shape"},
        {"bomb.pt", "a: its tensors are far larger than the file"},
        {"many.pt", "its tensors are far larger than the file"},
        {"huge_storage.pt", "a: a storage of 1152921504606846976 elements"},
    };
    for (const auto& [name, words] : cases) {
        const std::string message = messageOf<InputError>([&] { readWeights(kFolder / name); });
        EXPECT_NE(message.find(name), std::string::npos) << message;
        EXPECT_NE(message.find(words), std::string::npos) << message;
        EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    }
    const std::string other = "GIF89a, no weights at all";
    EXPECT_NE(messageOf<InputError>([&] {
                  weightsFromBytes({reinterpret_cast<const uint8_t*>(other.data()), other.size()},
                                   "cat.gif");
              }).find("cat.gif: expected a safetensors file or what torch.save writes"),
              std::string::npos);
}

// Every way of cutting a file short, and every flipped byte, is an error of the file or harmless.
TEST(Weights, SurvivesDamage) {
    for (const char* name : {"state_dict.pt", "legacy.pt"}) {
        const std::vector<uint8_t> whole = readWholeFile(kFolder / name);
        for (size_t size = 0; size < whole.size(); ++size)
            EXPECT_THROW(weightsFromBytes(std::span(whole).first(size), name), InputError) << size;
        std::vector<uint8_t> bytes = whole;
        for (size_t i = 0; i < whole.size(); ++i)
            for (uint8_t flip : {uint8_t{1}, uint8_t{128}, uint8_t{255}}) {
                bytes[i] = whole[i] ^ flip;
                try {
                    weightsFromBytes(bytes, name);
                } catch (const InputError&) {
                }
                bytes[i] = whole[i];
            }
    }
}

// What only PyTorch files hold stays refused in plain pickles.
TEST(Weights, PlainPicklesHoldNoTensors) {
    const std::vector<uint8_t> legacy = readWholeFile(kFolder / "legacy.pt");
    size_t consumed = 0;
    EXPECT_EQ(torchPickleFromBytes(legacy, "a", consumed).kind(), PickleValue::Kind::object);
    const std::string text =
        "\x80\x02"
        "ctorch._utils\n_rebuild_tensor_v2\n.";
    EXPECT_NE(
        messageOf<InputError>([&] {
            pickleFromBytes({reinterpret_cast<const uint8_t*>(text.data()), text.size()}, "a.pkl");
        }).find("refers to code (torch._utils._rebuild_tensor_v2)"),
        std::string::npos);
}

}  // namespace
}  // namespace doppel
