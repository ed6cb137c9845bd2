// Cuts the person out of a clip's frames, with whatever the clip offers: the network's mask, the
// colours of the whole clip, what other frames show behind, a camera that stands still, a plate, a
// screen, a network of the user's.
#pragma once

#include <filesystem>
#include <memory>
#include <span>
#include <string>

#include "trainer/import/masks/chroma_key.h"
#include "trainer/import/masks/matting.h"
#include "trainer/person/masks/mask.h"
#include "trainer/person/masks/moving_background.h"

namespace doppel {

// How far a clip's own masks go, each further than the one before: as the network has them, led
// along the picture's edges, by the colours of the whole clip, and with what is behind the person
// or a screen.
enum class CutOutBy { Network, Edges, Colours, All };
// "network", "edges", "colours", "all". InputError for another name.
CutOutBy cutOutByName(const std::string& name);

// A frame's mask, and how the ways to it agree.
struct FrameCut {
    std::vector<uint8_t> mask;  // [H,W], 255 on the person and 0 elsewhere
    double doubtful = 0;        // pixels of which it is not sure, over the person's
    double network = 0;         // IoU with the network's own mask
};

// IoU of a mask with a network's share of the person.
double agreement(const std::vector<uint8_t>& mask, const std::vector<float>& share);

class ClipCutter {
public:
    // InputError where the plate is no picture. Empty: there is none.
    explicit ClipCutter(std::filesystem::path plate,
                        std::unique_ptr<MattingNetwork> matting = nullptr,
                        CutOutBy by = CutOutBy::All)
        : plate_(std::move(plate)), matting_(std::move(matting)), by_(by) {}

    // In a first pass, each frame.
    void learn(const ClipView& view);

    // Then some of the frames again, from all over the clip, in which a screen is looked for.
    // InputError where the plate shows something else than they do.
    void finish(std::span<const ClipView> samples);

    // In a second pass, each frame by its number. look: any frame again.
    FrameCut cut(size_t frame, const ClipView& view, const MovingBackground::Look& look) const;

    // "the network", "the clip's colours", "a green screen, #1c9a3f", "the plate empty.jpg", …
    std::string source() const;

private:
    bool looksBehind() const;  // in other frames

    std::filesystem::path plate_;
    std::unique_ptr<MattingNetwork> matting_;  // where given, it decides
    CutOutBy by_;
    bool plateSet_ = false;
    ClipMasks masks_;
    MovingBackground moving_;
    std::unique_ptr<PersonKey> key_;
    std::string screen_;
};

}  // namespace doppel
