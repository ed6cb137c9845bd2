#include "trainer/data/capture_writer.h"

#include <algorithm>
#include <vector>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/npz.h"
#include "engine/io/image.h"
#include "trainer/data/capture_notes.h"

namespace doppel {
namespace fs = std::filesystem;

CaptureWriter::CaptureWriter(const fs::path& folder, std::string_view work)
    : output_(folder, "capture", work) {}

void CaptureWriter::copyImage(const std::string& name, const fs::path& file) {
    createFolders(output_.folder() / "images");
    const fs::path place = fs::path("images") / (name + file.extension().string());
    if (file != output_.folder() / place) copyFile(file, output_.folder() / place);
    images_[name] = place;
}

void CaptureWriter::copyMask(const std::string& name, const fs::path& file) {
    createFolders(output_.folder() / "masks");
    const fs::path place = fs::path("masks") / (name + file.extension().string());
    if (file != output_.folder() / place) copyFile(file, output_.folder() / place);
    masks_[name] = place;
}

void CaptureWriter::addImage(const std::string& name, int width, int height,
                             std::span<const uint8_t> rgb) {
    Image image(width, height, 3);
    CHECK(rgb.size() == image.data.size(), "a picture is [{}][{}][3]", height, width);
    std::copy(rgb.begin(), rgb.end(), image.data.begin());
    createFolders(output_.folder() / "images");
    images_[name] = fs::path("images") / (name + ".png");
    writeImage(output_.folder() / images_[name], image);
}

void CaptureWriter::addMask(const std::string& name, int width, int height,
                            std::span<const uint8_t> mask) {
    Image image(width, height, 1);
    CHECK(mask.size() == image.data.size(), "a mask is [{}][{}]", height, width);
    std::transform(mask.begin(), mask.end(), image.data.begin(),
                   [](uint8_t value) { return uint8_t(value > 0 ? 255 : 0); });
    createFolders(output_.folder() / "masks");
    masks_[name] = fs::path("masks") / (name + ".png");
    writeImage(output_.folder() / masks_[name], image);
}

Capture CaptureWriter::commit(const Capture& capture) {
    const size_t frames = capture.size();
    const fs::path& folder = output_.folder();
    CHECK(frames > 0, "a capture to write has frames");
    CHECK(capture.theta.size() == frames && capture.trans.size() == frames,
          "a capture has a pose per frame");
    for (const Frame& frame : capture.frames) {
        CHECK(images_.contains(frame.name), "the frame {} was added before commit()", frame.name);
        if (!masks_.empty() && !masks_.contains(frame.name)) {
            throwInput("{}: expected masks for all frames or for none, found none for {}",
                       output_.target().string(), frame.name);
        }
    }

    std::vector<Camera> cameras;
    CaptureNotes notes{capture.name, capture.fps, capture.actor,  capture.motion,
                       {},           "",          capture.source, capture.sourceBetas};
    for (const Frame& frame : capture.frames) {
        cameras.push_back(frame.camera);
        notes.frames.push_back(frame.name);
    }
    writeNpz(folder / "cameras.npz", camerasArrays(cameras), false);
    writeNpz(folder / "poses.npz", posesArrays(capture.theta, capture.trans, capture.betas), false);

    if (capture.keypoints) {
        const Keypoints& k = *capture.keypoints;
        writeNpy(folder / "keypoints.npy",
                 Array::f32({int64_t(frames), int64_t(k.count), 3}, k.values));
        notes.scheme = k.scheme;
    }
    if (std::ranges::any_of(capture.faces, [](const SeenFace& face) { return !face.empty(); })) {
        std::vector<float> values;
        for (SeenFace face : capture.faces) {
            face.resize(kFacePoints);
            for (const auto& point : face) values.insert(values.end(), point.begin(), point.end());
        }
        writeNpy(folder / "faces.npy",
                 Array::f32({int64_t(frames), int64_t(kFacePoints), 3}, values));
    }
    const std::string written = notesText(notes);
    writeWholeFile(folder / "capture.toml",
                   std::span(reinterpret_cast<const uint8_t*>(written.data()), written.size()));

    // What would not be read back is not written.
    Capture result;
    try {
        result = readCapture(folder);
    } catch (const InputError& error) {
        std::string sentence = error.what();
        const std::string temporary = folder.string();
        const size_t at = sentence.find(temporary);
        if (at != std::string::npos) {
            sentence.replace(at, temporary.size(), output_.target().string());
        }
        throw InputError(sentence);
    }
    output_.commit();
    result.folder = output_.target();
    for (Frame& frame : result.frames) {
        frame.image = result.folder / images_.at(frame.name);
        if (frame.mask) frame.mask = result.folder / masks_.at(frame.name);
    }
    return result;
}

Capture writeCapture(const Capture& capture, const fs::path& folder) {
    CaptureWriter writer(folder);
    return writeCapture(capture, writer);
}

Capture writeCapture(const Capture& capture, CaptureWriter& writer) {
    for (const Frame& frame : capture.frames) {
        writer.copyImage(frame.name, frame.image);
        if (frame.mask) writer.copyMask(frame.name, *frame.mask);
    }
    return writer.commit(capture);
}

}  // namespace doppel
