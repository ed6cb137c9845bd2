// Pictures that show whether camera, poses and masks go together.
#pragma once

#include <span>
#include <vector>

#include "engine/io/image.h"
#include "trainer/data/capture.h"
#include "trainer/import/import.h"

namespace doppel {

// The body, tinted and see-through, over the frame, with its outline in white and the mask's (where
// the frame has one) in green. At most `longest` pixels a side.
Image overlayPicture(const Picture& frame, const BodyPicture& body, int longest = 1280);

// Pictures of one size in rows of `columns`.
Image tiles(std::span<const Image> pictures, int columns);

}  // namespace doppel
