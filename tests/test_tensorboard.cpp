// Event files, taken apart again: record framing, checksums, scalars and pictures.
#include "engine/io/tensorboard.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstring>
#include <map>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "tests/files.h"

namespace doppel {
namespace {

using test::Folder;

template <typename T>
T load(std::string_view bytes, size_t at) {
    T value;
    if (at + sizeof(T) > bytes.size()) {
        ADD_FAILURE() << "cut off at " << at;
        return {};
    }
    std::memcpy(&value, bytes.data() + at, sizeof(T));
    return value;
}

// CRC-32C bit by bit, from its polynomial: not the table that the writer uses.
uint32_t slowCrc(std::string_view bytes) {
    uint32_t crc = ~0u;
    for (const char c : bytes) {
        for (int bit = 0; bit < 8; ++bit) {
            const bool odd =
                (crc ^ static_cast<uint32_t>(static_cast<unsigned char>(c) >> bit)) & 1;
            crc = (crc >> 1) ^ (odd ? 0x82F63B78u : 0u);
        }
    }
    crc = ~crc;
    return ((crc >> 15) | (crc << 17)) + 0xa282ead8u;
}

std::vector<std::string> records(std::string_view file) {
    std::vector<std::string> result;
    while (!file.empty()) {
        const auto length = load<uint64_t>(file, 0);
        EXPECT_EQ(load<uint32_t>(file, 8), slowCrc(file.substr(0, 8)));
        if (length + 16 > file.size()) {
            ADD_FAILURE() << "a record is longer than the file";
            break;
        }
        const std::string_view event = file.substr(12, length);
        EXPECT_EQ(load<uint32_t>(file, 12 + length), slowCrc(event));
        result.emplace_back(event);
        file.remove_prefix(16 + length);
    }
    return result;
}

// Field number → its bytes (varints as 8 bytes). Each field stands once in what is written here.
std::map<uint64_t, std::string> fields(std::string_view message) {
    std::map<uint64_t, std::string> result;
    size_t at = 0;
    const auto varint = [&] {
        uint64_t value = 0;
        for (int shift = 0; at < message.size(); shift += 7) {
            const uint8_t byte = static_cast<uint8_t>(message[at++]);
            value |= uint64_t{byte & 127u} << shift;
            if (byte < 128) return value;
        }
        ADD_FAILURE() << "a number is cut off";
        return value;
    };
    while (at < message.size()) {
        const uint64_t key = varint();
        uint64_t size = (key & 7) == 1 ? 8 : 4;
        if ((key & 7) == 0) {
            const uint64_t value = varint();
            result[key >> 3] = std::string(reinterpret_cast<const char*>(&value), 8);
            continue;
        }
        if ((key & 7) == 2) size = varint();
        EXPECT_LE(size, message.size() - at);
        EXPECT_FALSE(result.contains(key >> 3));
        result[key >> 3] = message.substr(at, size);
        at += size;
    }
    return result;
}

std::string contentOf(const std::filesystem::path& path) {
    const std::vector<uint8_t> bytes = readWholeFile(path);
    return {bytes.begin(), bytes.end()};
}

TEST(TensorBoard, knowsTheChecksum) {
    // CRC-32C of "123456789" is E3069283.
    const uint32_t crc = 0xE3069283u;
    EXPECT_EQ(maskedCrc32c("123456789"), ((crc >> 15) | (crc << 17)) + 0xa282ead8u);
    EXPECT_EQ(maskedCrc32c("123456789"), slowCrc("123456789"));
}

double secondsSince1970() {
    return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch())
        .count();
}

TEST(TensorBoard, eventsAreReadBack) {
    Folder folder;
    Image picture(5, 3, 3, 120);
    const double before = secondsSince1970();
    EventWriter writer(folder / "runs" / "a");
    writer.scalar("mesh/silhouette", 0, 0.75f);
    // Readers see every event at once.
    EXPECT_EQ(records(contentOf(writer.path())).size(), 2u);
    writer.scalar("mesh/silhouette", 100'000, -2.5f);
    writer.image("mesh/frame", 7, picture);

    const std::string name = writer.path().filename().string();
    EXPECT_TRUE(name.starts_with("events.out.tfevents.")) << name;
    EXPECT_NE(name.find(".doppel"), std::string::npos);

    const std::vector<std::string> events = records(contentOf(writer.path()));
    ASSERT_EQ(events.size(), 4u);
    EXPECT_EQ(fields(events[0]).at(3), "brain.Event:2");
    const double written = load<double>(fields(events[0]).at(1), 0);
    EXPECT_GE(written, before);
    EXPECT_LE(written, secondsSince1970());

    const auto value = [&](size_t i) { return fields(fields(fields(events[i]).at(5)).at(1)); };
    EXPECT_EQ(load<int64_t>(fields(events[1]).at(2), 0), 0);
    EXPECT_EQ(value(1).at(1), "mesh/silhouette");
    EXPECT_EQ(load<float>(value(1).at(2), 0), 0.75f);
    EXPECT_EQ(load<int64_t>(fields(events[2]).at(2), 0), 100'000);
    EXPECT_EQ(load<float>(value(2).at(2), 0), -2.5f);

    EXPECT_EQ(value(3).at(1), "mesh/frame");
    const auto image = fields(value(3).at(4));
    EXPECT_EQ(load<int64_t>(image.at(1), 0), 3) << "height";
    EXPECT_EQ(load<int64_t>(image.at(2), 0), 5) << "width";
    EXPECT_EQ(load<int64_t>(image.at(3), 0), 3) << "channels";
    const std::string& png = image.at(4);
    EXPECT_EQ(decodeImage({reinterpret_cast<const uint8_t*>(png.data()), png.size()}, "png").data,
              picture.data);
}

TEST(TensorBoard, twoWritersDoNotMeet) {
    Folder folder;
    EventWriter a(folder.path()), b(folder.path());
    EXPECT_NE(a.path(), b.path());
    folder.write("file", std::string("x"));
    EXPECT_THROW(EventWriter(folder / "file"), MachineError);
}

}  // namespace
}  // namespace doppel
