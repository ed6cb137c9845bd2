// Pictures that put several things side by side.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/io/image.h"

namespace doppel {

// Pictures of one size, row by row.
Image contactSheet(const std::vector<std::vector<Image>>& rows);

// White where both are, red where only the mask is, blue where only the silhouette is. [H,W]
Image compareMasks(const std::vector<uint8_t>& mask, const std::vector<uint8_t>& silhouette,
                   int width, int height);

// [H,W,3] values in [0,1] as a picture.
Image toImage(const std::vector<float>& rgb, int width, int height);

// |a - b| times gain.
Image differenceImage(const std::vector<float>& a, const std::vector<float>& b, int width,
                      int height, float gain);

}  // namespace doppel
