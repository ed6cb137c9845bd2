// How good an import of a clip is, frame by frame, as far as it can be told without a truth.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "trainer/import/clip.h"
#include "trainer/person/blazepose.h"

namespace doppel {

inline constexpr double kFlickerSeconds = .1;

struct FrameQuality {
    std::string name;
    std::string picture;   // its file in the folder that was imported; empty of a video
    double presence = 0;   // [0,1]: the network's, that there is a person
    double landmarks = 0;  // [0,1]: shoulders to feet, how surely they are seen: the mean
    double agreement = 0;  // IoU of the mask with the network's own
    double doubtful = 0;   // pixels of which the mask is not sure, over the person's
    // Pixels that differ from the frames before and after, which agree, over the person's; nothing
    // where these are more than kFlickerSeconds away, since motion does that, too.
    std::optional<double> flicker;
    bool cutOff = false;  // a foot or the head is outside of the picture
};

struct ClipQuality {
    std::vector<FrameQuality> frames;
    struct LeftOut {
        int64_t number = 0;  // in the clip
        double time = 0;     // seconds
        std::string why;
        std::string picture = {};  // as FrameQuality has it
    };
    std::vector<LeftOut> leftOut;
    std::string masks;  // how they were made
    size_t seen = 0;    // frames of the clip that were looked at
};

// What is seen of the person in a picture of this size; the mask's figures are left at 0.
FrameQuality qualityOf(std::string name, const PersonLandmarks& person, int width, int height);

// "duplicate", "blurred"; empty of what was kept or not asked for.
std::string whyLeftOut(const ClipFrame& frame);

// "masks agree with the network's to .95; 3 % of the person's pixels are in doubt, .4 % flicker;
// landmarks are seen to .97; least sure: 000012, 000045, 000051".
std::string summary(const ClipQuality& quality);
// "the feet are outside of the picture in 30 of 40 frames: …"; empty: they are not.
std::string cutOff(const ClipQuality& quality);

// docs/formats.md has its fields.
void writeQuality(const std::filesystem::path& file, const ClipQuality& quality);

// Counts pixels that are different in one mask only: of masks in order, one at a time.
class FlickerMeter {
public:
    // [H,W], > 0 inside. Gives the flicker of the mask before, over its pixels; nothing where it
    // has no neighbour on both sides.
    std::optional<double> next(const std::vector<uint8_t>& mask);
    // The next mask has nothing to do with those before.
    void forget();

private:
    std::vector<uint8_t> before_, last_;
};

}  // namespace doppel
