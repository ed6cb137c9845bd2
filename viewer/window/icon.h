// The application's icon, for title bars and task switchers.
#pragma once

#include "engine/io/image.h"

namespace doppel {

// As packaging/doppel.svg has it: R, G, B, A, straight alpha, side by side pixels.
Image applicationIcon(int side);

}  // namespace doppel
