// What a capture lacks, before hours are spent on it.
#pragma once

#include <string>
#include <vector>

#include "trainer/data/capture.h"

namespace doppel {

// Which of "front", "back", "right side" and "left side" no frame shows, told by the heading of the
// pelvis, for the poses as they are.
std::vector<std::string> unseenSides(const Capture& capture);

// The same as a sentence, with what to do; empty where all are seen.
std::string whatIsNotSeen(const Capture& capture);

}  // namespace doppel
