// Hands are small, and poses follow them by a centimetre or two: what fingers lie before, trousers
// or a screen, leaves its colours on their sides.
#pragma once

#include <vector>

#include "nn/body/body.h"

namespace doppel {

// Gives texels of the hands whose colour is not the hands' that of those around them on the hand.
// texels [size,size,3] in [0,1]. A hand's colour is the median of both hands' texels; another is
// one whose chromaticity lies two and a half times as far from it as most do (their median
// distance), or which is a third or three times as bright. Where that would be more than a third
// of them they stay as they are: gloves of two colours, say. Returns how many texels changed.
size_t cleanHands(const BodyModel& body, int size, std::vector<float>& texels);

}  // namespace doppel
