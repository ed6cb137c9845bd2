// Captures written to disk.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <string_view>

#include "trainer/data/capture.h"
#include "trainer/data/output_folder.h"

namespace doppel {

// Writes a capture into a temporary folder beside its place; commit() renames it. Without commit()
// nothing is left. A capture there that Doppel wrote is replaced as a whole; anything else that is
// not an empty folder is refused (InputError).
//
//     CaptureWriter writer("fitted");
//     for (...) writer.addImage(name, width, height, rgb), writer.addMask(name, ...);
//     writer.commit(capture);
class CaptureWriter {
public:
    // work: see OutputFolder.
    explicit CaptureWriter(const std::filesystem::path& folder, std::string_view work = {});

    // The temporary folder, for whatever else belongs to the capture (overlays).
    const std::filesystem::path& folder() const { return output_.folder(); }

    // What a run of the same work has left is in the folder.
    bool goesOn() const { return output_.goesOn(); }
    // Leaves the folder to the next run of the same work.
    void leave() noexcept { output_.leave(); }

    // A file that is in its place already stays there.
    void copyImage(const std::string& name, const std::filesystem::path& file);
    void copyMask(const std::string& name, const std::filesystem::path& file);
    // PNG. rgb: [H][W][3], mask: [H][W], > 0 the person.
    void addImage(const std::string& name, int width, int height, std::span<const uint8_t> rgb);
    void addMask(const std::string& name, int width, int height, std::span<const uint8_t> mask);

    // Writes cameras, poses, keypoints, faces and capture.toml (frames[i].image and mask are looked
    // up by name among what was added), checks them as readCapture does, and renames the folder.
    // Returns the capture as it is now on disk.
    Capture commit(const Capture& capture);

private:
    OutputFolder output_;
    std::map<std::string, std::filesystem::path> images_, masks_;  // relative to the folder
};

// The capture with its pictures copied to another folder (which may be its own).
Capture writeCapture(const Capture& capture, const std::filesystem::path& folder);
Capture writeCapture(const Capture& capture, CaptureWriter& writer);

}  // namespace doppel
