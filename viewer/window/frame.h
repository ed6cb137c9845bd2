// What a window shows, put together: pictures, and the interface over them. The host does it, or
// the device on which pictures lie; both come to the same bytes (shaders/view/compose.h).
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "engine/device.h"
#include "engine/recorder.h"
#include "viewer/window/canvas.h"

namespace doppel {

// Of R, G, B, A, opaque, [height,width], placed in framebuffer pixels. What is later lies above.
struct PlacedPicture {
    int x = 0, y = 0, width = 0, height = 0;
    std::span<const uint32_t> pixels;
    // That it is of a picture which nobody changes: with the same one the pixels are the same.
    // null: they may be others in each frame.
    std::shared_ptr<const void> unchanging;
    // Instead of pixels, for a window whose device composes.
    std::shared_ptr<const Buffer> onDevice;
};

// A composed frame: rows of four bytes per pixel, without gaps; opaque.
struct Canvas {
    int width = 0, height = 0;
    bool blueFirst = false;  // the order of a pixel's bytes: blue, green, red, or red first
    std::span<uint32_t> pixels;

    std::span<uint32_t> row(int y) const {
        return pixels.subspan(static_cast<size_t>(y) * static_cast<size_t>(width),
                              static_cast<size_t>(width));
    }
};

// A box of a frame, within it, and the picture that it shows the upper left part of; null: a
// colour.
struct FramePart {
    PixelBox box;
    const PlacedPicture* picture = nullptr;
    uint32_t colour = 0;
};
// All of a frame of this size, in the order in which they are drawn: the pictures, and what is
// beside them in one colour. What the window has no room for is left out.
std::vector<FramePart> partsOfFrame(std::span<const PlacedPicture> pictures, int width, int height,
                                    uint32_t colour);

// On the host, which has all the pictures' pixels.
void compose(std::span<const FramePart> parts, const InterfaceLayer& layer, const Canvas& canvas);

// On the device. Of what the host has, only what is not as in the frame before goes there.
class DeviceComposer {
public:
    explicit DeviceComposer(Device& device) : device_(device) {}

    // Starts it, and does not wait: the frame [H,W] is in this buffer once the device's queue gets
    // to what is submitted next. The frame before is done. pictures: those that the parts are of.
    const Buffer& compose(std::span<const PlacedPicture> pictures, std::span<const FramePart> parts,
                          const InterfaceLayer& layer, bool blueFirst);
    // That the last frame took from the host.
    uint64_t uploadedBytes() const { return uploadedBytes_; }
    // The last frame, for who wants to see it here; it waits.
    Canvas read();

private:
    // What the host has drawn, in the device's memory.
    struct Copy {
        Buffer pixels;
        int width = 0, height = 0;
        std::vector<uint32_t> known;  // as it is there
        std::shared_ptr<const void> unchanging;
    };
    // A box of a copy that is to be as the host has it.
    struct Patch {
        const Buffer* target;
        int targetWidth;
        PixelBox box;
        const uint32_t* pixels;  // of the whole
    };
    void update(Copy& copy, const PlacedPicture& picture);
    void update(const InterfaceLayer& layer);
    void upload();
    void record(const char* kernel, const PixelBox& box, const BufferView& picture,
                int pictureWidth, const Buffer& frame, int frameWidth, uint32_t colour);

    Device& device_;
    std::vector<Copy> copies_;  // of the host's pictures, in their order
    Copy layer_;
    std::vector<Patch> patches_;
    Buffer staging_, frame_;
    bool blueFirst_ = false;
    std::optional<Recorder> recorder_;
    std::vector<std::shared_ptr<const Buffer>> shown_;  // in the frame that is on its way
    uint64_t uploadedBytes_ = 0;
    std::vector<uint32_t> read_;
};

}  // namespace doppel
