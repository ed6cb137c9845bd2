#include "trainer/import/masks/clip_cutter.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/error.h"
#include "trainer/eval/metrics.h"
#include "trainer/person/masks/mask_tools.h"

namespace doppel {

namespace {

constexpr double kPlateDistance = 16;   // values of 255: more is another scene
constexpr double kNear = 1. / 16;       // of the square's side
constexpr double kLeastAgreement = .7;  // IoU of a key's mask with the network's
// Of the square's side: whole pixels that hold a screen's light.
constexpr double kChoke = 1. / 800;

std::vector<uint8_t> surely(const std::vector<float>& share) {
    std::vector<uint8_t> mask(share.size());
    std::ranges::transform(share, mask.begin(),
                           [](float s) { return uint8_t(s >= .5f ? 255 : 0); });
    return mask;
}

// The square about a person in which a matting network looks, as far as the picture goes: of a
// whole one, in which people are small, it would see few pixels of them.
Rect squareAround(const std::vector<uint8_t>& person, int width, int height) {
    constexpr double kMargin = 1. / 6;  // of the square's side, on either side of the person
    Rect box{width, height, 0, 0};
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x) {
            if (!person[size_t(y) * size_t(width) + size_t(x)]) continue;
            box = {std::min(box.left, x), std::min(box.top, y), std::max(box.right, x + 1),
                   std::max(box.bottom, y + 1)};
        }
    if (box.empty()) return {0, 0, width, height};
    const int half = int(std::ceil(std::max(box.width(), box.height()) / (2 - 4 * kMargin))),
              x = (box.left + box.right) / 2, y = (box.top + box.bottom) / 2;
    return {std::max(0, x - half), std::max(0, y - half), std::min(width, x + half),
            std::min(height, y + half)};
}

// What a network makes of a part of the picture; nobody is elsewhere.
std::vector<float> matteOf(MattingNetwork& network, const Image& rgb, const Rect& part) {
    Image inside(part.width(), part.height(), 3);
    for (int y = 0; y < inside.height; ++y)
        std::copy_n(&rgb.data[3 * (size_t(part.top + y) * size_t(rgb.width) + size_t(part.left))],
                    3 * size_t(inside.width), inside.pixel(0, y));
    const std::vector<float> found = network.share(inside);
    std::vector<float> matte(size_t(rgb.width) * size_t(rgb.height));
    for (int y = 0; y < inside.height; ++y)
        std::copy_n(&found[size_t(y) * size_t(inside.width)], inside.width,
                    &matte[size_t(part.top + y) * size_t(rgb.width) + size_t(part.left)]);
    return matte;
}

Picture pictureOf(const Image& rgb) { return {rgb.width, rgb.height, rgb.data, {}}; }

}  // namespace

CutOutBy cutOutByName(const std::string& name) {
    constexpr std::array kNames{"network", "edges", "colours", "all"};
    const auto found = std::ranges::find(kNames, name);
    if (found == kNames.end())
        throwInput("--cut-out: expected network, edges, colours or all, found {}", name);
    return static_cast<CutOutBy>(found - kNames.begin());
}

void ClipCutter::learn(const ClipView& view) {
    const Image& rgb = view.rgb;
    if (!plate_.empty() && !plateSet_) {
        Image plate = readImage(plate_);
        const double across = double(plate.width) / rgb.width,
                     down = double(plate.height) / rgb.height;
        if (std::abs(across / down - 1) > .01) {
            throwInput(
                "{}: expected a picture as wide and high as the frames ({}×{}) or in "
                "proportion, found {}×{}",
                plate_.string(), rgb.width, rgb.height, plate.width, plate.height);
        }
        masks_.setPlate(resize(plate, rgb.width, rgb.height));
        plateSet_ = true;
    }
    masks_.learn(view);
    moving_.add(view.share, rgb.width, rgb.height);
}

void ClipCutter::finish(std::span<const ClipView> samples) {
    masks_.finish(by_ == CutOutBy::All);
    CHECK(!samples.empty(), "a clip has frames");
    if (plateSet_) {
        std::vector<double> distances;
        for (const ClipView& sample : samples)
            distances.push_back(masks_.background().distance(sample.rgb, sample.share));
        std::ranges::sort(distances);
        const double middle = distances[distances.size() / 2];
        if (middle > kPlateDistance) {
            throwInput(
                "{}: expected what the frames show without the person, by a camera that "
                "stands still; where nobody is they differ from it by {:.0f} of 255",
                plate_.string(), middle);
        }
        return;
    }
    if (by_ != CutOutBy::All) return;
    std::vector<std::shared_ptr<const Picture>> pictures;
    std::vector<std::vector<uint8_t>> people, borders;
    for (const ClipView& sample : samples) {
        pictures.push_back(std::make_shared<Picture>(pictureOf(sample.rgb)));
        borders.push_back(borderOf(*pictures.back()));
        people.push_back(surely(sample.share));
    }
    screen_ = screenOf(borders);
    if (!screen_.empty()) key_ = std::make_unique<PersonKey>(pictures, people, "the clip");
}

double agreement(const std::vector<uint8_t>& mask, const std::vector<float>& share) {
    return intersectionOverUnion(mask, surely(share));
}

bool ClipCutter::looksBehind() const {
    return by_ == CutOutBy::All && !matting_ && !key_ && !masks_.usesBackground() &&
           moving_.tells();
}

FrameCut ClipCutter::cut(size_t frame, const ClipView& view,
                         const MovingBackground::Look& look) const {
    const auto& [rgb, share, part, side] = view;
    const std::vector<uint8_t> network = surely(share);
    ClipMasks::Behind behind;
    if (looksBehind())
        behind = [&](const Rect& rect, const std::vector<uint8_t>& wanted) {
            return moving_.favour(frame, view, rect, wanted, look);
        };
    CutOut own = by_ == CutOutBy::Network ? cutOutAsGiven(view)
                 : by_ == CutOutBy::Edges ? cutOutAlongEdges(view)
                                          : masks_.cutOut(view, behind);
    FrameCut result{std::move(own.mask), own.doubtful, 0};
    if (matting_) {
        // It finds everybody: the person is whoever is near the network's mask.
        const std::vector<float> matte =
            matteOf(*matting_, rgb, squareAround(network, rgb.width, rgb.height));
        const auto away = distanceTo(network, rgb.width, rgb.height);
        std::vector<uint8_t> cutOut(matte.size());
        for (size_t i = 0; i < matte.size(); ++i)
            cutOut[i] = matte[i] >= .5f && double(away[i]) < kNear * side ? 255 : 0;
        if (intersectionOverUnion(cutOut, network) >= kLeastAgreement)
            result.mask = std::move(cutOut);
    } else if (key_) {
        std::vector<uint8_t> keyed = key_->mask(pictureOf(rgb), network);
        // A person who leaves the screen, or wears its colour, is not what is before it.
        if (intersectionOverUnion(keyed, network) >= kLeastAgreement) {
            const auto depth = distanceTo(invertedMask(keyed), rgb.width, rgb.height);
            const auto choke = float(std::floor(side * kChoke));
            for (size_t i = 0; i < keyed.size(); ++i)
                if (depth[i] <= choke) keyed[i] = 0;
            result.mask = std::move(keyed);
        }
    }
    result.network = intersectionOverUnion(result.mask, network);
    return result;
}

std::string ClipCutter::source() const {
    if (matting_) return fmt::format("the matting network {}", matting_->name());
    if (plateSet_) return fmt::format("the plate {}", plate_.filename().string());
    if (key_) {
        const auto [r, g, b] = key_->screen().colour();
        return fmt::format("a {} screen, #{:02x}{:02x}{:02x}", screen_, r, g, b);
    }
    if (by_ == CutOutBy::Network) return "the network";
    if (by_ == CutOutBy::Edges) return "the network, led along edges";
    if (masks_.usesBackground())
        return "the clip's colours and what is behind, for the camera stands still";
    if (looksBehind()) return "the clip's colours and what is behind, as other frames show it";
    return "the clip's colours";
}

}  // namespace doppel
