// HEIC and AVIF, what telephones take pictures in, by libheif.
#pragma once

#include <memory>

#include "engine/io/pictures/codecs.h"

namespace doppel {

// The file's primary picture, upright, in 8 bits. The parameters are those of PictureCodecs::open.
std::unique_ptr<PictureFile> openHeif(const std::string& name, std::span<const uint8_t> file);

}  // namespace doppel
