// Weights on disk: what is written is read back bit for bit, and no header is believed unchecked.
#include "engine/io/safetensors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "tests/files.h"

namespace doppel {
namespace {

using test::Folder;
using test::messageOf;

Safetensors sample() {
    Safetensors content;
    content.tensors["layer.0.weight"] = {{2, 3}, {1, -2, 3.5f, 1e-42f, -0.0f, 3e38f}};
    content.tensors["layer.0.bias"] = {{2}, {NAN, std::numeric_limits<float>::infinity()}};
    content.tensors["step"] = {{}, {17}};
    content.tensors["none"] = {{0, 4}, {}};
    content.metadata = {{"program", "doppel 0.1"}, {"name", "Zoë \"z\"\n"}};
    return content;
}

std::vector<uint8_t> file(const std::string& header, size_t dataSize) {
    std::vector<uint8_t> bytes(8 + header.size() + dataSize);
    const uint64_t size = header.size();
    std::memcpy(bytes.data(), &size, 8);
    std::memcpy(bytes.data() + 8, header.data(), header.size());
    return bytes;
}

TEST(Safetensors, readsBackWhatItWrites) {
    Folder folder;
    writeSafetensors(folder / "a.safetensors", sample());
    EXPECT_EQ(folder.names(), std::vector<std::string>{"a.safetensors"});
    const Safetensors back = readSafetensors(folder / "a.safetensors");
    ASSERT_EQ(back.tensors.size(), 4u);
    EXPECT_EQ(back.metadata, sample().metadata);
    for (const auto& [name, tensor] : sample().tensors) {
        EXPECT_EQ(back.at(name).shape, tensor.shape);
        ASSERT_EQ(back.at(name).values.size(), tensor.values.size());
        if (!tensor.values.empty()) {
            EXPECT_EQ(std::memcmp(back.at(name).values.data(), tensor.values.data(),
                                  tensor.values.size() * 4),
                      0)
                << name;
        }
    }
    writeSafetensors(folder / "b.safetensors", back);
    const std::vector<uint8_t> bytes = readWholeFile(folder / "a.safetensors");
    EXPECT_EQ(bytes, readWholeFile(folder / "b.safetensors"));
    uint64_t header = 0;
    std::memcpy(&header, bytes.data(), 8);
    EXPECT_EQ(header % 8, 0u) << "the data is aligned";

    const std::vector<int64_t> right = {2, 3}, wrong = {3, 2};
    EXPECT_EQ(back.at("layer.0.weight", right).values.size(), 6u);
    EXPECT_NE(messageOf<InputError>([&] {
                  back.at("layer.0.weight", wrong);
              }).find("a.safetensors: layer.0.weight: expected shape [3, 2], found [2, 3]"),
              std::string::npos);
    EXPECT_NE(messageOf<InputError>([&] { back.at("layer.1.weight"); }).find("'layer.1.weight'"),
              std::string::npos);
}

TEST(Safetensors, convertsOtherFloats) {
    const std::string header = R"({"b":{"dtype":"BF16","shape":[1],"data_offsets":[0,2]},)"
                               R"("h":{"dtype":"F16","shape":[1],"data_offsets":[2,4]},)"
                               R"("d":{"dtype":"F64","shape":[1],"data_offsets":[4,12]}})";
    std::vector<uint8_t> bytes = file(header, 12);
    const uint8_t data[12] = {0xC0, 0x3F, 0x00, 0xC0, 0, 0, 0, 0, 0, 0, 0xD0, 0x3F};
    std::memcpy(&bytes[bytes.size() - 12], data, 12);
    const Safetensors content = safetensorsFromBytes(bytes, "x");
    EXPECT_EQ(content.at("b").values, std::vector<float>{1.5f});
    EXPECT_EQ(content.at("h").values, std::vector<float>{-2});
    EXPECT_EQ(content.at("d").values, std::vector<float>{0.25f});
}

TEST(Safetensors, refusesLies) {
    const auto refusal = [](const std::string& header, size_t dataSize) {
        const auto bytes = file(header, dataSize);
        return messageOf<InputError>([&] { safetensorsFromBytes(bytes, "w.safetensors"); });
    };
    const std::string a = R"("a":{"dtype":"F32","shape":[2],"data_offsets":[0,8]})";
    EXPECT_EQ(safetensorsFromBytes(file("{" + a + "}", 8), "x").at("a").values.size(), 2u);
    EXPECT_NE(refusal("{" + a + "}", 7).find("a: cut short"), std::string::npos);
    EXPECT_NE(refusal("{" + a + "}", 9).find("1 bytes after the last"), std::string::npos);
    EXPECT_NE(refusal("{" + a + R"(,"b":{"dtype":"F32","shape":[2],"data_offsets":[4,12]}})", 12)
                  .find("overlap or leave a gap"),
              std::string::npos);
    EXPECT_NE(refusal("{" + a + R"(,"b":{"dtype":"F32","shape":[1],"data_offsets":[12,16]}})", 16)
                  .find("overlap or leave a gap"),
              std::string::npos);
    EXPECT_NE(refusal("{" + a + "," + a + "}", 8).find("stands twice"), std::string::npos);
    EXPECT_NE(refusal(R"({"a":{"dtype":"I64","shape":[1],"data_offsets":[0,8]}})", 8)
                  .find("type I64; expected F32"),
              std::string::npos);
    for (const char* entry :
         {"1", "{}", R"({"dtype":"F32","shape":2,"data_offsets":[0,8]})",
          R"({"dtype":"F32","shape":[2],"data_offsets":[0]})",
          R"({"dtype":"F32","shape":[-2],"data_offsets":[0,8]})",
          R"({"dtype":"F32","shape":[2.0],"data_offsets":[0,8]})",
          R"({"dtype":"F32","shape":[3],"data_offsets":[0,8]})",
          R"({"dtype":"F32","shape":[2],"data_offsets":[8,0]})",
          R"({"dtype":"F32","shape":[2],"data_offsets":[-8,0]})",
          R"({"dtype":"F32","shape":[2],"data_offsets":[0,18446744073709551615]})",
          R"({"dtype":"F32","shape":[4611686018427387904,4],"data_offsets":[0,0]})"}) {
        EXPECT_NE(refusal(std::string("{\"a\":") + entry + "}", 8).find("w.safetensors: a: "),
                  std::string::npos)
            << entry;
    }
    EXPECT_NE(refusal("[1, 2]", 0).find("not the JSON"), std::string::npos);
    EXPECT_NE(refusal("{\"a\":", 0).find("not the JSON"), std::string::npos);
    EXPECT_NE(refusal(std::string(100'000, '['), 0).find("expected JSON nested at most 64"),
              std::string::npos);
    EXPECT_NE(refusal(R"({"__metadata__":{"a":1}})", 0).find("expected texts"), std::string::npos);
    std::vector<uint8_t> huge(16, 0xFF);
    EXPECT_NE(messageOf<InputError>([&] { safetensorsFromBytes(huge, "w"); }).find("at most"),
              std::string::npos);
    Folder folder;
    EXPECT_THROW(readSafetensors(folder / "none.safetensors"), InputError);
}

TEST(Safetensors, damageIsRefusedNotFollowed) {
    Folder folder;
    writeSafetensors(folder / "a.safetensors", sample());
    const std::vector<uint8_t> whole = readWholeFile(folder / "a.safetensors");
    for (size_t size = 0; size < whole.size(); ++size) {
        EXPECT_THROW(safetensorsFromBytes(std::span(whole).first(size), "cut"), InputError) << size;
    }
    std::mt19937 random(2);
    for (int round = 0; round < 5000; ++round) {
        std::vector<uint8_t> damaged = whole;
        for (int i = 0; i <= round % 3; ++i) {
            damaged[random() % damaged.size()] = static_cast<uint8_t>(random());
        }
        try {
            safetensorsFromBytes(damaged, "damaged");
        } catch (const InputError&) {
        }
    }
}

}  // namespace
}  // namespace doppel
