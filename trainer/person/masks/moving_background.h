// What is behind the person of a clip whose camera moves.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "trainer/person/masks/clip_view.h"
#include "trainer/person/masks/colour_model.h"

namespace doppel {

// Pictures of moments at which the person was elsewhere, brought to where the camera looks at
// another one: by what stands still, place by place, for what is near moves otherwise than what is
// far. It holds two kilobytes of each picture at most, of whatever size.
class MovingBackground {
public:
    // The clip's pictures by their numbers; called on several threads at a time.
    using Look = std::function<std::shared_ptr<const ClipView>(size_t)>;

    // personShare() of each picture in the clip's order, all of one size.
    void add(const std::vector<float>& share, int width, int height);
    // Whether the clip has pictures enough.
    bool tells() const;

    // [rect] of a picture, as StillBackground::favour(): log of how much likelier each pixel is not
    // what is behind; 0 where too few others showed that, and where it is not wanted ([rect]).
    std::vector<float> favour(size_t picture, const ClipView& view, const Rect& rect,
                              const std::vector<uint8_t>& wanted, const Look& look) const;

private:
    std::vector<size_t> othersOf(size_t picture, double side) const;

    int width_ = 0, height_ = 0, cell_ = 1, columns_ = 0, rows_ = 0;
    std::vector<std::vector<bool>> covered_;  // [picture][rows, columns]: the person is there
};

}  // namespace doppel
