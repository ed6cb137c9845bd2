// Clips of synthetic actors as a phone in a hand would film them, with the truth beside them.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "engine/device.h"
#include "trainer/motion/synthetic.h"

namespace doppel {

struct HandHeldOptions {
    int width = 540, height = 960;  // pixels
    double fps = 30;
    double longerSideDegrees = 66;  // that the picture's longer side sees
    bool still = false;             // the camera stands still, its exposure too
    bool plain = false;             // before a wall of one colour, screen[], and no room
    std::array<float, 3> screen{.10f, .62f, .22f};  // sRGB-encoded
    uint64_t seed = 1;
    int samples = 2;  // per pixel and axis
};

// The distance at which a person with raised arms is whole in such a picture, metres.
constexpr float kTakeDistance = 2.4f;

// Somebody in the clip. Poses are in the room (trainer/motion/room.h), seen from the origin; every
// body is stood on the floor.
struct Performer {
    const Actor* actor = nullptr;
    std::vector<MotionFrame> motion;  // of the clip's length
};

// Films the performers: who is nearer hides the others. The camera shakes and turns a little as a
// hand does, its exposure and white balance drift, its sensor has noise, and H.264 does the rest.
// The truth of the first performer goes into the folder `truth`, one frame after the other:
//
//     masks/NNNNNN.png   what is seen of the performer
//     poses.npz          as a capture has it, in the camera's frame of that moment, and `joints`
//                        [F,24,3], metres, for an actor's bones are not the body model's
//     cameras.npz        the camera that filmed it
void filmHandHeld(Device& device, std::span<const Performer> performers,
                  const std::filesystem::path& clip, const std::filesystem::path& truth,
                  const HandHeldOptions& options);

}  // namespace doppel
