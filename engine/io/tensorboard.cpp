#include "engine/io/tensorboard.h"

#include <fcntl.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>

#include "engine/error.h"
#include "engine/io/protobuf.h"

namespace doppel {
namespace {

constexpr std::array<uint32_t, 256> makeCrcTable() {
    std::array<uint32_t, 256> table{};
    for (uint32_t i = 0; i < 256; ++i) {
        uint32_t crc = i;
        for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? 0x82F63B78u : 0u);
        table[i] = crc;
    }
    return table;
}

double now() {
    return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch())
        .count();
}

// tensorflow.Event: 1 wall_time, 2 step, 3 file_version, 5 summary {1 value}.
ProtoMessage makeEvent(int64_t step, const ProtoMessage& summaryValue) {
    ProtoMessage summary, event;
    summary.message(1, summaryValue);
    event.real64(1, now()).varint(2, static_cast<uint64_t>(step)).message(5, summary);
    return event;
}

}  // namespace

uint32_t maskedCrc32c(std::string_view bytes) {
    static constexpr std::array<uint32_t, 256> kTable = makeCrcTable();
    uint32_t crc = 0xFFFFFFFF;
    for (const char c : bytes) crc = crc >> 8 ^ kTable[(crc ^ static_cast<unsigned char>(c)) & 255];
    crc = ~crc;
    return (crc >> 15 | crc << 17) + 0xA282EAD8u;
}

EventWriter::EventWriter(const std::filesystem::path& folder) {
    std::error_code error;
    std::filesystem::create_directories(folder, error);
    if (error) throwMachine("{}: cannot make the folder: {}", folder.string(), error.message());
    static std::atomic<unsigned> counter{0};
    const auto seconds = static_cast<int64_t>(now());
    // TensorBoard asks for ".tfevents." in the name and reads the files in the order of names.
    path_ = folder / fmt::format("events.out.tfevents.{:010}.doppel.{}.{}", seconds, getpid(),
                                 counter.fetch_add(1));
    descriptor_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_APPEND | O_CLOEXEC, 0666);
    if (descriptor_ < 0) {
        throwMachine("{}: cannot create it: {}", path_.string(), std::strerror(errno));
    }
    try {
        writeEvent(ProtoMessage().real64(1, now()).bytes(3, "brain.Event:2").text());
    } catch (...) {
        ::close(descriptor_);
        ::unlink(path_.c_str());
        throw;
    }
}

EventWriter::~EventWriter() { ::close(descriptor_); }

void EventWriter::scalar(std::string_view tag, int64_t step, float value) {
    // Summary.Value: 1 tag, 2 simple_value.
    writeEvent(makeEvent(step, ProtoMessage().bytes(1, tag).real32(2, value)).text());
}

void EventWriter::image(std::string_view tag, int64_t step, const Image& picture) {
    const std::vector<uint8_t> png = encodePng(picture);
    // Summary.Image: 1 height, 2 width, 3 colorspace (the number of channels), 4 the file's bytes.
    ProtoMessage image;
    image.varint(1, static_cast<uint64_t>(picture.height))
        .varint(2, static_cast<uint64_t>(picture.width))
        .varint(3, static_cast<uint64_t>(picture.channels))
        .bytes(4, {reinterpret_cast<const char*>(png.data()), png.size()});
    // Summary.Value: 1 tag, 4 image.
    writeEvent(makeEvent(step, ProtoMessage().bytes(1, tag).message(4, image)).text());
}

// TFRecord: length (8 bytes), masked CRC of the length, the event, masked CRC of the event.
void EventWriter::writeEvent(const std::string& event) {
    const uint64_t length = event.size();
    std::string record(reinterpret_cast<const char*>(&length), 8);
    const uint32_t lengthCrc = maskedCrc32c(record);
    record.append(reinterpret_cast<const char*>(&lengthCrc), 4);
    record += event;
    const uint32_t eventCrc = maskedCrc32c(event);
    record.append(reinterpret_cast<const char*>(&eventCrc), 4);
    const off_t before = ::lseek(descriptor_, 0, SEEK_END);
    size_t done = 0;
    while (done < record.size()) {
        const ssize_t written = ::write(descriptor_, record.data() + done, record.size() - done);
        if (written < 0) {
            if (errno == EINTR) continue;
            const int error = errno;
            // A full disk must not leave half a record that readers stumble over.
            if (before >= 0 && ::ftruncate(descriptor_, before) != 0) {
            }
            throwMachine("{}: cannot write it: {}", path_.string(), std::strerror(error));
        }
        done += static_cast<size_t>(written);
    }
}

}  // namespace doppel
