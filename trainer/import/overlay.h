// Pictures that show whether camera, poses and masks go together.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "engine/io/image.h"
#include "trainer/data/frame_cache.h"

namespace doppel {

// A body in a pose, as the camera sees it.
struct BodyPicture {
    std::vector<uint8_t> mask;  // [H][W], 255 where the body is, 0 elsewhere
    std::vector<float> shade;   // [H][W], how light it is there, [0,1]; may be empty
};
using DrawBody = std::function<BodyPicture(const Camera& camera, const Theta& theta,
                                           const Trans& trans, const Betas& betas)>;

// The body, tinted and see-through, over the frame, with its outline in white and the mask's (where
// the frame has one) in green. At most `longest` pixels a side.
Image overlayPicture(const Picture& frame, const BodyPicture& body, int longest = 1280);

// What is not the person is darkened, and the bones between keypoints of the scheme openpose25
// ([25][3]: u, v in pixels, confidence) are drawn: the left side's orange, the right side's blue,
// the less sure the fainter. At most `longest` pixels a side.
Image skeletonPicture(const Picture& frame, std::span<const float> keypoints, int longest = 960);

// Boxes with numbers from 1; the chosen one in green. At most `longest` pixels a side.
struct Box {
    double left = 0, top = 0, right = 0, bottom = 0;  // pixels
};
Image numberedPicture(const Image& rgb, std::span<const Box> boxes, size_t chosen,
                      int longest = 1280);

// Pictures of one size in rows of `columns`.
Image tiles(std::span<const Image> pictures, int columns);

}  // namespace doppel
