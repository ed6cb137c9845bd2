#include "trainer/person/masks/clip_view.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>
#include <utility>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr double kFootShare = 1. / 50;  // of the square's side: a foot's half width
constexpr float kInDoubt = .49f;        // a share
// Of the line from heel to toes, what lies in the mask of a foot that the network has seen.
constexpr double kFootSeen = .9;

// The picture's place of a landmark, pixels.
glm::dvec2 placeOf(const PersonLandmarks& person, size_t point) {
    const Point3& p = person.points[point].picture;
    return {p[0], p[1]};
}

glm::dvec2 nearestOnLine(const glm::dvec2& p, const glm::dvec2& a, const glm::dvec2& b) {
    const glm::dvec2 along = b - a;
    const double t = glm::dot(p - a, along) / std::max(glm::dot(along, along), 1e-9);
    return a + std::clamp(t, 0., 1.) * along;
}

struct Line {
    PicturedPart part;
    glm::dvec2 a, b;
};

std::vector<Line> linesOf(const PersonLandmarks& person) {
    using namespace landmark;
    using enum PicturedPart;
    const auto at = [&](size_t point) { return placeOf(person, point); };
    const auto between = [&](size_t a, size_t b) { return (at(a) + at(b)) / 2.; };
    const glm::dvec2 ears = between(kLeftEar, kRightEar), mouth = between(kMouthLeft, kMouthRight),
                     chest = between(kLeftShoulder, kRightShoulder);
    constexpr double kNeck = .6;  // of the way from mouth to chest
    std::vector<Line> lines{{Head, ears, at(kNose)},
                            {Head, ears, glm::mix(mouth, chest, kNeck)},
                            {Trunk, chest, between(kLeftHip, kRightHip)}};
    for (const auto& [part, a, b] : {
             std::tuple{Trunk, kLeftShoulder, kRightShoulder},
             {Trunk, kLeftShoulder, kLeftHip},
             {Trunk, kRightShoulder, kRightHip},
             {Trunk, kLeftHip, kRightHip},
             {UpperArm, kLeftShoulder, kLeftElbow},
             {UpperArm, kRightShoulder, kRightElbow},
             {Forearm, kLeftElbow, kLeftWrist},
             {Forearm, kRightElbow, kRightWrist},
             {Forearm, kLeftWrist, kLeftIndex},
             {Forearm, kRightWrist, kRightIndex},
             {Thigh, kLeftHip, kLeftKnee},
             {Thigh, kRightHip, kRightKnee},
             {Calf, kLeftKnee, kLeftAnkle},
             {Calf, kRightKnee, kRightAnkle},
             {Foot, kLeftHeel, kLeftFootTip},
             {Foot, kRightHeel, kRightFootTip},
         })
        lines.push_back({part, at(a), at(b)});
    return lines;
}

}  // namespace

std::vector<float> personShare(const PersonLandmarks& person, int width, int height) {
    constexpr int kSide = kRoiMaskSide;
    CHECK(person.mask.size() == size_t(kSide) * kSide, "a mask is [{},{}]", kSide, kSide);
    std::vector<float> inside(person.mask.size());
    for (size_t i = 0; i < inside.size(); ++i) inside[i] = 1 / (1 + std::exp(-person.mask[i]));
    std::vector<float> share(size_t(width) * size_t(height));
    const auto at = [&](int x, int y) {
        return inside[size_t(std::clamp(y, 0, kSide - 1)) * kSide +
                      size_t(std::clamp(x, 0, kSide - 1))];
    };
    // The square is turned and scaled: steps along the picture's axes are the same everywhere.
    const Point2 first = person.roi.fromPicture({.5, .5}),
                 across = person.roi.fromPicture({1.5, .5}),
                 down = person.roi.fromPicture({.5, 1.5});
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            Point2 p;
            for (size_t i = 0; i < 2; ++i)
                p[i] = first[i] + x * (across[i] - first[i]) + y * (down[i] - first[i]);
            if (p[0] < 0 || p[1] < 0 || p[0] >= 1 || p[1] >= 1) continue;
            const double u = p[0] * kSide - .5, v = p[1] * kSide - .5;
            const int u0 = int(std::floor(u)), v0 = int(std::floor(v));
            const auto a = float(u - u0), b = float(v - v0);
            share[size_t(y) * size_t(width) + size_t(x)] =
                (1 - b) * ((1 - a) * at(u0, v0) + a * at(u0 + 1, v0)) +
                b * ((1 - a) * at(u0, v0 + 1) + a * at(u0 + 1, v0 + 1));
        }
    }
    return share;
}

std::vector<float> personShareWithFeet(const PersonLandmarks& person, int width, int height) {
    std::vector<float> share = personShare(person, width, height);
    using namespace landmark;
    const double radius = kFootShare * person.roi.side;
    const auto at = [&](size_t point) { return placeOf(person, point); };
    const auto isSeen = [&](const glm::dvec2& heel, const glm::dvec2& toes) {
        constexpr int kPoints = 20;
        int inPicture = 0, seen = 0;
        for (int k = 0; k <= kPoints; ++k) {
            const glm::dvec2 p = glm::floor(glm::mix(heel, toes, double(k) / kPoints));
            if (!(p.x >= 0 && p.y >= 0 && p.x < width && p.y < height)) continue;
            ++inPicture;
            seen += share[size_t(p.y) * size_t(width) + size_t(p.x)] >= .5f;
        }
        return seen >= kFootSeen * inPicture;
    };
    using Foot = std::array<size_t, 3>;
    for (const auto& [ankle, heel, toes] : {Foot{kLeftAnkle, kLeftHeel, kLeftFootTip},
                                            Foot{kRightAnkle, kRightHeel, kRightFootTip}}) {
        // The outline of a foot that was seen is better than that of a line as thick as a foot,
        // which holds the shadow beside a heel.
        if (isSeen(at(heel), at(toes))) continue;
        for (const auto& [a, b] : {std::pair(at(ankle), at(heel)), std::pair(at(heel), at(toes)),
                                   std::pair(at(toes), at(ankle))}) {
            // What is longer is no foot.
            if (!(glm::length(b - a) < person.roi.side / 4)) continue;
            const glm::dvec2 picture(width, height), none(0);
            const auto low = glm::clamp(glm::min(a, b) - radius, none, picture),
                       high = glm::clamp(glm::max(a, b) + radius, none, picture);
            for (int y = int(low.y); y < int(high.y); ++y)
                for (int x = int(low.x); x < int(high.x); ++x) {
                    const glm::dvec2 p(x + .5, y + .5);
                    float& s = share[size_t(y) * size_t(width) + size_t(x)];
                    if (glm::distance(p, nearestOnLine(p, a, b)) < radius)
                        s = std::max(s, kInDoubt);
                }
        }
    }
    return share;
}

std::vector<uint8_t> picturedPartsOf(const PersonLandmarks& person, int width, int height) {
    constexpr int kStep = 4;  // pixels that are next to the same part
    const std::vector<Line> lines = linesOf(person);
    std::vector<uint8_t> parts(size_t(width) * size_t(height));
    for (int y = 0; y < height; y += kStep)
        for (int x = 0; x < width; x += kStep) {
            const glm::dvec2 p(x + kStep / 2., y + kStep / 2.);
            const auto distance = [&](const Line& line) {
                const glm::dvec2 away = p - nearestOnLine(p, line.a, line.b);
                return glm::dot(away, away);
            };
            const auto part = uint8_t(std::ranges::min_element(lines, {}, distance)->part);
            for (int v = y; v < std::min(y + kStep, height); ++v)
                std::fill_n(&parts[size_t(v) * size_t(width) + size_t(x)],
                            std::min(kStep, width - x), part);
        }
    return parts;
}

ClipView clipViewOf(const PersonLandmarks& person, Image rgb) {
    ClipView view{std::move(rgb), {}, {}, person.roi.side};
    view.share = personShareWithFeet(person, view.rgb.width, view.rgb.height);
    view.part = picturedPartsOf(person, view.rgb.width, view.rgb.height);
    return view;
}

}  // namespace doppel
