// Masks of a clip's pictures that somebody made before: a folder of pictures, or a video.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

namespace doppel {

// One mask for each picture of a clip, in their order: the person is where they are lighter, or,
// cut out, more opaque than half, for mattes have soft rims; of small numbers, which are labels,
// all that are not 0.
class GivenMasks {
public:
    // pictures: how many the clip has. InputError where a folder has another number of masks.
    GivenMasks(const std::filesystem::path& masks, size_t pictures);
    ~GivenMasks();

    // That of the next picture, which has these sides: [height,width], 255 on the person and 0
    // elsewhere. InputErrors name the file: one that is damaged, a video that ends before the clip,
    // masks of another shape.
    std::vector<uint8_t> next(int width, int height);
    // One that nobody wants.
    void skip();
    // After the last. InputError where a video goes on.
    void finish();

private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

}  // namespace doppel
