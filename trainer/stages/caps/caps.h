// Stage "caps": hair that hangs free, skirts and what else masks hold beyond a body, as surfaces of
// their own.
//
// A surface that grows from the body's carries hair and neck at once: what is between them can't be
// seen through, and a skirt is two legs. So what all masks hold and no body explains is carved out
// of space (the visual hull, Laurentini 1994), in the rest pose: a cell beside the body moves with
// the skin next to it, and stays if the frames of each side have it within their masks. What stays
// and lies far enough from the body becomes a mesh (nn/body/body_caps.h), which the stages after
// this one move, colour and draw with the body. Of two sides it has to be seen where the body is
// not, for beside a trunk all masks hold the arms. In few frames the head alone has one.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "engine/device.h"
#include "nn/body/body_caps.h"
#include "nn/steps/caps_numbers.h"
#include "trainer/data/capture.h"
#include "trainer/data/frame_cache.h"

namespace doppel {

// What grew, or why nothing did.
struct GrownCap {
    std::optional<BodyCap> cap = {};
    double litres = 0;
    std::string why = {};  // where there is no cap, in words that go on after "no cap: "
};

// For the capture's poses and betas, and its masks. The body has no cap yet.
GrownCap growCap(Device& device, const BodyModel& body, const Capture& capture, FrameCache& frames,
                 const CapsPreset& preset);

}  // namespace doppel
