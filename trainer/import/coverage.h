// What a capture lacks, before hours are spent on it.
#pragma once

#include <string>

#include "trainer/data/capture.h"

namespace doppel {

// A sentence that says from which sides no frame shows the person, and what to do: sides are told
// by the heading of the pelvis, for the poses as they are. Empty where there is no gap of more than
// a third of a turn.
std::string whatIsNotSeen(const Capture& capture);

}  // namespace doppel
