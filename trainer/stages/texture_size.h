// How many texels a capture is worth.
#pragma once

#include "trainer/avatar/avatar.h"
#include "trainer/data/capture.h"
#include "trainer/stages/stage.h"

namespace doppel {

// The side of a texture, 512 or 1024, whose texels cover `texel` pixels of the
// sharpest frames at most, in the mean over the body and as far as 1024 go. Sharpest: nine of ten
// frames have fewer pixels for a metre of the person. The poses tell how far away the person is.
int textureSizeFor(const BodyModel& body, const Capture& capture, double texel);

// Where the preset leaves the textures' side to the frames (texture.textureSize 0): decides it, and
// how many texels the networks take as one, so that they stay as large as they were. An avatar
// whose texels are not learned anew keeps their number.
void decideTextureSize(Avatar& avatar, const Capture& capture, const TrainSettings& settings);

}  // namespace doppel
