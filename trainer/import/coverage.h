// What a capture lacks, before hours are spent on it.
#pragma once

#include <string>

#include "trainer/data/capture.h"

namespace doppel {

// A sentence that says which of front, back and sides no frame shows, and what to do. They are told
// by the heading of the pelvis, for the poses as they are; empty where all are seen.
std::string whatIsNotSeen(const Capture& capture);

}  // namespace doppel
