// The pixels of a capture's frames.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "engine/io/image.h"
#include "trainer/data/capture.h"

namespace doppel {

// 8-bit, rows from the top.
struct Picture {
    int width = 0, height = 0;
    std::vector<uint8_t> rgb;   // [H][W][3], sRGB-encoded, divided by the frame's gain; or empty
    std::vector<uint8_t> mask;  // [H][W], 255 the person, 0 not; empty where the frame has none
};

// Decodes the frames of a capture on demand and keeps the latest ones. Can be used from several
// threads.
class FrameCache {
public:
    explicit FrameCache(const Capture& capture, size_t memoryBudget = size_t{512} << 20);
    // InputError where the file is cut short, or no longer what readCapture saw.
    std::shared_ptr<const Picture> load(size_t frame);
    // The same for who needs no colours, in a fraction of the time: rgb may be empty. The file of
    // the colours is looked at as far as checkImage() does.
    std::shared_ptr<const Picture> loadMask(size_t frame);

    // Its colours in grey, ceil(side / by) pixels a side (readSmallGrey()), not divided by a gain
    // and not kept: of large frames in a fraction of the time.
    Image readSmallGrey(size_t frame, int by);

    // Pictures that all caches of this process have decoded so far, be it masks from their runs.
    static uint64_t decoded() { return decoded_; }

private:
    std::shared_ptr<const Picture> load(size_t frame, bool colours);

    static inline std::atomic<uint64_t> decoded_ = 0;
    const Capture& capture_;
    size_t budget_, used_ = 0;
    std::mutex mutex_;
    std::list<std::pair<size_t, std::shared_ptr<const Picture>>> kept_;  // latest first
};

}  // namespace doppel
