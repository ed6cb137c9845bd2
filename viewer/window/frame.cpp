#include "viewer/window/frame.h"

#include <algorithm>
#include <cstring>

#include "view/compose.h"
#include "view/params.h"

namespace doppel {

namespace {

size_t placeOf(int x, int y, int width) {
    return static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x);
}

uint64_t bytesOf(const PixelBox& box) {
    return sizeof(uint32_t) * static_cast<uint64_t>(box.area());
}

// Around the pixels in which two pictures [height,width] differ.
PixelBox differenceOf(std::span<const uint32_t> a, std::span<const uint32_t> b, int width,
                      int height) {
    int left = width, right = 0, top = height, bottom = 0;
    for (int y = 0; y < height; ++y) {
        const uint32_t *one = &a[placeOf(0, y, width)], *other = &b[placeOf(0, y, width)];
        const auto wide = static_cast<size_t>(width);
        if (std::memcmp(one, other, sizeof(uint32_t) * wide) == 0) continue;
        int from = 0, to = width;
        while (one[from] == other[from]) ++from;
        while (one[to - 1] == other[to - 1]) --to;
        left = std::min(left, from), right = std::max(right, to);
        top = std::min(top, y), bottom = y + 1;
    }
    return bottom == 0 ? PixelBox{} : PixelBox{left, top, right - left, bottom - top};
}

}  // namespace

std::vector<FramePart> partsOfFrame(std::span<const PlacedPicture> pictures, int width, int height,
                                    uint32_t colour) {
    // Pictures side by side from the corner leave what is right of them and below; others anything.
    int64_t covered = 0;
    int right = 0, bottom = 0;
    for (size_t i = 0; i < pictures.size(); ++i) {
        const PlacedPicture& p = pictures[i];
        // One that lies on another covers no more than that does.
        const bool within = std::ranges::any_of(pictures.first(i), [&](const PlacedPicture& other) {
            return p.x >= other.x && p.x + p.width <= other.x + other.width && p.y >= other.y &&
                   p.y + p.height <= other.y + other.height;
        });
        if (!within) covered += int64_t{p.width} * p.height;
        right = std::max(right, p.x + p.width);
        bottom = std::max(bottom, p.y + p.height);
    }
    if (covered != int64_t{right} * bottom) right = bottom = 0;
    std::vector<FramePart> parts;
    const auto add = [&](PixelBox box, const PlacedPicture* picture) {
        box.width = std::min(box.width, width - box.x);
        box.height = std::min(box.height, height - box.y);
        if (box.width > 0 && box.height > 0) parts.push_back({box, picture, colour});
    };
    add({right, 0, width - right, bottom}, nullptr);
    add({0, bottom, width, height - bottom}, nullptr);
    for (const PlacedPicture& p : pictures) add({p.x, p.y, p.width, p.height}, &p);
    return parts;
}

void compose(std::span<const FramePart> parts, const InterfaceLayer& layer, const Canvas& canvas) {
    const uint32_t blueFirst = canvas.blueFirst ? 1 : 0;
    for (const FramePart& part : parts) {
        const PixelBox& box = part.box;
        CHECK(!part.picture || !part.picture->onDevice, "the host composes what it has");
        for (int y = 0; y < box.height; ++y) {
            const uint32_t* below =
                part.picture ? &part.picture->pixels[placeOf(0, y, part.picture->width)] : nullptr;
            const uint32_t* above = &layer.row(box.y + y)[static_cast<size_t>(box.x)];
            uint32_t* to = &canvas.row(box.y + y)[static_cast<size_t>(box.x)];
            const auto [first, last] = layer.drawn(box.y + y);
            const int from = std::clamp(first - box.x, 0, box.width),
                      until = std::clamp(last - box.x, from, box.width);
            const auto alone = [&](int x, int end) {
                if (!below)
                    std::fill(to + x, to + end, inOrder(part.colour, blueFirst));
                else
                    std::transform(below + x, below + end, to + x,
                                   [&](uint32_t pixel) { return inOrder(pixel, blueFirst); });
            };
            alone(0, from);
            for (int x = from; x < until; ++x)
                to[x] = composed(below ? below[x] : part.colour, above[x], blueFirst);
            alone(until, box.width);
        }
    }
}

void DeviceComposer::update(Copy& copy, const PlacedPicture& picture) {
    PixelBox changed{0, 0, picture.width, picture.height};
    if (copy.width != picture.width || copy.height != picture.height) {
        copy.width = picture.width, copy.height = picture.height;
        copy.pixels = device_.allocate(bytesOf(changed), Memory::Device);
        copy.known.assign(picture.pixels.begin(), picture.pixels.end());
    } else if (picture.unchanging && picture.unchanging == copy.unchanging) {
        return;
    } else {
        changed = differenceOf(copy.known, picture.pixels, copy.width, copy.height);
        for (int y = changed.y; y < changed.y + changed.height; ++y)
            std::copy_n(&picture.pixels[placeOf(changed.x, y, copy.width)], changed.width,
                        &copy.known[placeOf(changed.x, y, copy.width)]);
    }
    copy.unchanging = picture.unchanging;
    patches_.push_back({&copy.pixels, copy.width, changed, copy.known.data()});
}

void DeviceComposer::update(const InterfaceLayer& layer) {
    PixelBox changed = layer.changed();
    if (layer_.width != layer.width() || layer_.height != layer.height()) {
        layer_.width = layer.width(), layer_.height = layer.height();
        changed = {0, 0, layer.width(), layer.height()};
        layer_.pixels = device_.allocate(bytesOf(changed), Memory::Device);
        frame_ = device_.allocate(bytesOf(changed), Memory::Device);
    }
    patches_.push_back({&layer_.pixels, layer_.width, changed, layer.row(0).data()});
}

// The patches, one behind the other through memory that the host maps.
void DeviceComposer::upload() {
    std::erase_if(patches_, [](const Patch& patch) { return patch.box.area() == 0; });
    uint64_t bytes = 0;
    uploadedBytes_ = 0;
    for (const Patch& patch : patches_) {
        bytes += alignUp(bytesOf(patch.box), kBufferAlignment);
        uploadedBytes_ += bytesOf(patch.box);
    }
    if (staging_.bytes() < bytes) staging_ = device_.allocate(bytes, Memory::Upload);
    uint64_t offset = 0;
    for (const Patch& patch : patches_) {
        const PixelBox& box = patch.box;
        const BufferView view{&staging_, offset, bytesOf(box)};
        const size_t rowBytes = sizeof(uint32_t) * static_cast<size_t>(box.width);
        for (int y = 0; y < box.height; ++y)
            std::memcpy(view.mapped() + static_cast<size_t>(y) * rowBytes,
                        patch.pixels + placeOf(box.x, box.y + y, patch.targetWidth), rowBytes);
        record("view/compose.patch", box, view, box.width, *patch.target, patch.targetWidth, 0);
        offset += alignUp(view.bytes, kBufferAlignment);
    }
    patches_.clear();
}

void DeviceComposer::record(const char* kernel, const PixelBox& box, const BufferView& picture,
                            int pictureWidth, const Buffer& frame, int frameWidth,
                            uint32_t colour) {
    const auto u32 = [](auto value) { return static_cast<uint32_t>(value); };
    // Few workgroups, for each costs a CPU microseconds.
    const uint32_t size = device_.kernelPath().onCpu ? 256 : 64;
    const ComposeParams params{
        u32(box.x),      u32(box.y),        u32(box.area()), divisorOf(u32(box.width)),
        u32(frameWidth), u32(pictureWidth), colour,          blueFirst_ ? 1u : 0u};
    std::vector<BoundBuffer> buffers{{"picture", picture}, {"frame", {&frame, 0, frame.bytes()}}};
    if (&frame == &frame_) buffers.push_back({"layer", {&layer_.pixels, 0, layer_.pixels.bytes()}});
    recorder_->dispatch(device_.kernel(kernel, {{"local_size", size}}), buffers,
                        std::as_bytes(std::span(&params, 1)), linearGroups(params.pixels, size));
}

const Buffer& DeviceComposer::compose(std::span<const PlacedPicture> pictures,
                                      std::span<const FramePart> parts, const InterfaceLayer& layer,
                                      bool blueFirst) {
    recorder_.emplace(device_);  // the one before has ended
    shown_.clear();
    blueFirst_ = blueFirst;
    update(layer);
    const auto ofHost = [](const PlacedPicture& picture) { return !picture.onDevice; };
    copies_.resize(static_cast<size_t>(std::ranges::count_if(pictures, ofHost)));
    auto copy = copies_.begin();
    for (const PlacedPicture& picture : pictures)
        if (ofHost(picture)) update(*copy++, picture);
    upload();
    for (const FramePart& part : parts) {
        const PlacedPicture* picture = part.picture;
        // A colour reads no picture; something stands in for it.
        const Buffer* from = &layer_.pixels;
        if (picture && picture->onDevice) {
            from = picture->onDevice.get();
            shown_.push_back(picture->onDevice);
        } else if (picture) {
            const auto before = pictures.first(static_cast<size_t>(picture - pictures.data()));
            from = &copies_[static_cast<size_t>(std::ranges::count_if(before, ofHost))].pixels;
        }
        record("view/compose.forward", part.box, {from, 0, from->bytes()},
               picture ? picture->width : 0, frame_, layer.width(), part.colour);
    }
    recorder_->finish();
    recorder_->submit();
    return frame_;
}

Canvas DeviceComposer::read() {
    read_.resize(static_cast<size_t>(layer_.width) * static_cast<size_t>(layer_.height));
    if (recorder_) recorder_->wait();
    device_.download({&frame_, 0, frame_.bytes()}, std::as_writable_bytes(std::span(read_)));
    return {layer_.width, layer_.height, blueFirst_, read_};
}

}  // namespace doppel
