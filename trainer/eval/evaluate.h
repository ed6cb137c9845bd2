// How well an avatar shows a capture's frames.
//
// The paper's protocol: the avatar in each frame's pose, through the frame's camera and at its
// resolution, over the frame's background, compared with the whole real frame. Where the frame's
// gain is known (Capture::gains), the render has it.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "trainer/avatar/avatar.h"
#include "trainer/data/capture.h"
#include "trainer/eval/fvd.h"
#include "trainer/eval/lpips.h"
#include "trainer/eval/metrics.h"

namespace doppel {

// A rectangle of the atlas, which gets figures of its own in the pixels that show nothing else: a
// print, a face.
struct AtlasRegion {
    std::string name;                                 // of letters, digits and underscores
    double left = 0, top = 0, right = 1, bottom = 1;  // of the atlas, (0,0) its top left corner
};
// "print=.3,.2,.5,.4". InputError naming `where`.
AtlasRegion atlasRegion(std::string_view text, std::string_view where);

struct EvaluateSettings {
    // A folder for a report (trainer/eval/report.h); empty: none.
    std::filesystem::path pictures;
    TextureKind texture = TextureKind::Best;
    // What stands behind the render. "frame": the frame's own pixels away from the mask (a keyed
    // mask leaves all that is no person), and on and next to the mask the plate: the median over
    // time of what the masks leave uncovered. "median": the plate everywhere. Else a picture of the
    // scene without the person, of the frames' size, everywhere.
    std::string background = "frame";
    // The capture whose frames the plate is made of; null: the one that is evaluated.
    const Capture* plateOf = nullptr;
    std::vector<AtlasRegion> regions = {};  // beside the head
    Lpips* lpips = nullptr;                 // null: left out
    VideoFeatures* videoFeatures = nullptr;
};

struct Evaluation {
    std::vector<FrameMetrics> frames;
    // Mean |difference| of consecutive pictures of the person over black, in 8-bit units: of the
    // renders, and of the frames as their masks cut them out. A render that flickers changes more.
    double change = 0, changeOfFrames = 0;
    // The greatest difference when the first frame's pose is drawn again after all others: zero.
    double changeHeldStill = 0;
    // Features of the clips of real frames and of renders; see clipFeatures.
    std::vector<std::vector<double>> realClips, renderedClips;
};

Evaluation evaluateCapture(Device& device, const Avatar& avatar, const Capture& capture,
                           const EvaluateSettings& settings = {});

// Its frames, over the background "frame".
std::vector<FrameMetrics> evaluateAvatar(Device& device, const Avatar& avatar,
                                         const Capture& capture,
                                         const std::filesystem::path& pictures = {},
                                         TextureKind texture = TextureKind::Best);

// The Fréchet distance of the clips; nothing where there are fewer than two.
std::optional<double> videoDistance(const std::vector<std::vector<double>>& real,
                                    const std::vector<std::vector<double>>& rendered);

}  // namespace doppel
