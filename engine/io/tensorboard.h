// TensorBoard's event files: loss curves and pictures that `tensorboard --logdir` shows while a
// training runs.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "engine/io/image.h"

namespace doppel {

// Appends to one new file, `events.out.tfevents.<seconds>.doppel.<process>.<n>`, in a folder that
// it makes. Records are whole or absent: each goes to the file in one write. (Unlike the other
// writers this one writes in place, since it is read while it grows.) Errors: MachineError where
// the folder or the file cannot be written.
class EventWriter {
public:
    explicit EventWriter(const std::filesystem::path& folder);
    ~EventWriter();
    EventWriter(const EventWriter&) = delete;
    EventWriter& operator=(const EventWriter&) = delete;

    // Tags are paths, "mesh/silhouette"; TensorBoard groups by the part before the first slash.
    void scalar(std::string_view tag, int64_t step, float value);
    void image(std::string_view tag, int64_t step, const Image& picture);

    const std::filesystem::path& path() const { return path_; }

private:
    void writeEvent(const std::string& event);

    std::filesystem::path path_;
    int descriptor_ = -1;
};

// The checksum of the records: CRC-32C, rotated and offset as TFRecord has it.
uint32_t maskedCrc32c(std::string_view bytes);

}  // namespace doppel
