#include "trainer/person/blazepose.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>

#include "engine/error.h"
#include "engine/files/share.h"
#include "trainer/data/digest.h"
#include "trainer/person/picture_net.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr int kDetectorSide = 224, kLandmarkSide = 256, kHeatSide = 64;
static_assert(kLandmarkSide == kRoiMaskSide);
constexpr size_t kBoxNumbers = 12;
constexpr double kLeastScore = .5, kMostOverlap = .3;

const char* detectorFile() { return "pose_detection.tflite"; }
std::string landmarkFile(PoseNet net) {
    return std::string("pose_landmark_") + poseNetName(net) + ".tflite";
}

// Left for right, in maps [..,256,256].
void reverseRows(std::vector<float>& map) {
    for (size_t row = 0; row + kRoiMaskSide <= map.size(); row += kRoiMaskSide)
        std::reverse(map.begin() + int64_t(row), map.begin() + int64_t(row) + kRoiMaskSide);
}

double logistic(double x) { return 1 / (1 + std::exp(-x)); }

// Centres of the anchors in [0, 1]: cells of grids, row by row, some to each cell.
std::vector<Point2> anchors() {
    std::vector<Point2> centres;
    for (const auto& [side, each] : {std::pair{28, 2}, {14, 2}, {7, 6}})
        for (int y = 0; y < side; ++y)
            for (int x = 0; x < side; ++x)
                for (int i = 0; i < each; ++i)
                    centres.push_back({(x + .5) / side, (y + .5) / side});
    return centres;
}

// A detection in [0, 1] of the square: two corners, then the keypoints.
struct Candidate {
    double score;
    std::array<Point2, 6> points;
};

double overlap(const Candidate& a, const Candidate& b) {
    double shared = 1, areaA = 1, areaB = 1;
    for (size_t i : {0u, 1u}) {
        const double low = std::max(a.points[0][i], b.points[0][i]);
        const double high = std::min(a.points[1][i], b.points[1][i]);
        shared *= std::max(0., high - low);
        areaA *= a.points[1][i] - a.points[0][i];
        areaB *= b.points[1][i] - b.points[0][i];
    }
    const double all = areaA + areaB - shared;
    return all > 0 ? shared / all : 0;
}

}  // namespace

size_t oppositeLandmark(size_t number) {
    if (number == landmark::kNose || number >= landmark::kCount) return number;
    if (number <= 6) return number <= 3 ? number + 3 : number - 3;
    return number % 2 ? number + 1 : number - 1;
}

PoseNet poseNetByName(std::string_view name, std::string_view where) {
    for (PoseNet net : {PoseNet::Lite, PoseNet::Full, PoseNet::Heavy})
        if (name == poseNetName(net)) return net;
    throwInput("{}: expected lite, full or heavy, found \"{}\"", where, name);
}

const char* poseNetName(PoseNet net) {
    return net == PoseNet::Lite ? "lite" : net == PoseNet::Full ? "full" : "heavy";
}

fs::path poseModelFolder() {
    const char* folder = std::getenv("DOPPEL_MODELS");
    return folder && *folder ? folder : fetchedFolder("models");
}

bool poseModelsAreThere(PoseNet net, const fs::path& folder) {
    std::error_code error;
    return fs::exists(folder / detectorFile(), error) &&
           fs::exists(folder / landmarkFile(net), error);
}

// ---- running ------------------------------------------------------------------------------------

struct BlazePose::Net : PictureNet {
    using PictureNet::PictureNet;
};

BlazePose::BlazePose(Device& device, PoseNet net, fs::path folder)
    : device_(device), net_(net), folder_(std::move(folder)) {}

BlazePose::~BlazePose() = default;

void BlazePose::requireModels() const {
    for (const fs::path& file : {folder_ / detectorFile(), folder_ / landmarkFile(net_)})
        requireNetwork(file);
}

BlazePose::Net& BlazePose::detector() {
    if (!detector_) {
        const fs::path file = folder_ / detectorFile();
        const auto boxes = int64_t(anchors().size());
        detector_ = std::make_unique<Net>(device_, file, kDetectorSide,
                                          std::vector{boxes * int64_t(kBoxNumbers), boxes});
    }
    return *detector_;
}

BlazePose::Net& BlazePose::landmarker() {
    if (!landmarker_) {
        const fs::path file = folder_ / landmarkFile(net_);
        constexpr int64_t kAll = landmark::kAll;
        landmarker_ =
            std::make_unique<Net>(device_, file, kLandmarkSide,
                                  std::vector<int64_t>{5 * kAll, 1, kRoiMaskSide * kRoiMaskSide,
                                                       kAll * kHeatSide * kHeatSide, 3 * kAll});
    }
    return *landmarker_;
}

std::array<std::vector<float>, 2> BlazePose::runDetector(std::vector<float> rgb) {
    Net& net = detector();
    for (float& v : rgb) v = 2 * v - 1;
    auto raw = net.run(rgb);
    return {std::move(raw[0]), std::move(raw[1])};
}

std::array<std::vector<float>, 5> BlazePose::runLandmarks(const std::vector<float>& rgb) {
    std::array<std::vector<float>, 5> raw;
    std::ranges::move(landmarker().run(rgb), raw.begin());
    return raw;
}

std::vector<Detection> BlazePose::detect(const Image& rgb) {
    const std::vector<float> square =
        crop(rgb, roiOfPicture(rgb.width, rgb.height), kDetectorSide, Outside::Black);
    std::vector<Detection> people;
    const auto ask = [&] {
        const auto raw = runDetector(square);
        people = detections(raw[0], raw[1], rgb.width, rgb.height);
        AnswerLog::Answer bytes;
        append(bytes, std::span<const Detection>(people));
        return bytes;
    };
    Digest question;
    question.addText("detector");
    question.add(std::span<const float>(square));
    question.addValue(std::array{rgb.width, rgb.height});
    answer(
        log_, question,
        [&](std::span<const std::byte> kept) {
            people.resize(kept.size() / sizeof(Detection));
            return takeFront(kept, std::span<Detection>(people)) && kept.empty();
        },
        ask);
    return people;
}

PersonLandmarks BlazePose::ask(std::vector<float> square, const Roi& roi, bool bothWays) {
    PersonLandmarks person = landmarksOf(runLandmarks(square), roi);
    if (!bothWays) return person;
    reverseRows(square);
    const PersonLandmarks other = mirrored(landmarksOf(runLandmarks(square), roi));
    const auto mean = [](auto& a, const auto& b) { a = (a + b) / 2; };
    mean(person.presence, other.presence);
    for (size_t i = 0; i < person.points.size(); ++i) {
        Landmark& point = person.points[i];
        for (size_t k = 0; k < 3; ++k) {
            mean(point.picture[k], other.points[i].picture[k]);
            mean(point.world[k], other.points[i].world[k]);
        }
        mean(point.visibility, other.points[i].visibility);
        mean(point.presence, other.points[i].presence);
    }
    for (size_t i = 0; i < person.mask.size(); ++i) mean(person.mask[i], other.mask[i]);
    return person;
}

PersonLandmarks BlazePose::askOnce(const Image& rgb, const Roi& roi, bool bothWays) {
    std::vector<float> square = crop(rgb, roi, kLandmarkSide, Outside::Edge);
    Digest question;
    question.addText(poseNetName(net_));
    question.addText(bothWays ? ", both ways" : "");
    question.add(std::span<const float>(square));
    question.addValue(std::array{roi.centre[0], roi.centre[1], roi.side, roi.rotation});
    PersonLandmarks person;
    answer(
        log_, question,
        [&](std::span<const std::byte> kept) {
            person.roi = roi;
            person.mask.resize(size_t(kRoiMaskSide) * kRoiMaskSide);
            return takeFront(kept, person.presence) &&
                   takeFront(kept, std::span<Landmark>(person.points)) &&
                   takeFront(kept, std::span<float>(person.mask)) && kept.empty();
        },
        [&] {
            person = ask(std::move(square), roi, bothWays);
            AnswerLog::Answer bytes;
            append(bytes, person.presence);
            append(bytes, std::span<const Landmark>(person.points));
            append(bytes, std::span<const float>(person.mask));
            return bytes;
        });
    return person;
}

PersonLandmarks BlazePose::landmarks(const Image& rgb, const Roi& roi) {
    return askOnce(rgb, roi, false);
}

PersonLandmarks BlazePose::landmarksBothWays(const Image& rgb, const Roi& roi) {
    return askOnce(rgb, roi, true);
}

// ---- what the numbers mean ----------------------------------------------------------------------

std::vector<Detection> detections(const std::vector<float>& boxes, const std::vector<float>& scores,
                                  int width, int height) {
    static const std::vector<Point2> centres = anchors();
    CHECK(scores.size() == centres.size() && boxes.size() == kBoxNumbers * scores.size(),
          "there are {} boxes", centres.size());
    std::vector<Candidate> candidates;
    for (size_t a = 0; a < centres.size(); ++a) {
        const double score = logistic(std::clamp(double(scores[a]), -100., 100.));
        if (!(score >= kLeastScore)) continue;
        Candidate candidate{score, {}};
        const float* r = &boxes[a * kBoxNumbers];
        bool real = true;
        for (size_t i : {0u, 1u}) {
            const double middle = double(r[i]) / kDetectorSide + centres[a][i];
            const double size = double(r[2 + i]) / kDetectorSide;
            real = real && size >= 0;
            candidate.points[0][i] = middle - size / 2;
            candidate.points[1][i] = middle + size / 2;
            for (size_t k = 0; k < 4; ++k)
                candidate.points[2 + k][i] =
                    double(r[4 + 2 * k + i]) / kDetectorSide + centres[a][i];
        }
        if (real) candidates.push_back(candidate);
    }
    std::stable_sort(candidates.begin(), candidates.end(),
                     [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
    // Those that overlap the best are one person, whose numbers are their mean by scores.
    const Roi square = roiOfPicture(width, height);
    std::vector<Detection> people;
    while (!candidates.empty()) {
        const Candidate best = candidates.front();
        std::array<Point2, 6> mean{};
        double total = 0;
        std::vector<Candidate> others;
        for (const Candidate& candidate : candidates) {
            if (&candidate != &candidates.front() && overlap(best, candidate) <= kMostOverlap) {
                others.push_back(candidate);
                continue;
            }
            total += candidate.score;
            for (size_t p = 0; p < mean.size(); ++p)
                for (size_t i : {0u, 1u}) mean[p][i] += candidate.score * candidate.points[p][i];
        }
        for (Point2& point : mean) point = square.toPicture({point[0] / total, point[1] / total});
        people.push_back({best.score, {mean[0], mean[1]}, {mean[2], mean[3], mean[4], mean[5]}});
        candidates = std::move(others);
    }
    return people;
}

PersonLandmarks landmarksOf(std::array<std::vector<float>, 5> raw, const Roi& roi) {
    const auto& [points, presence, mask, heat, world] = raw;
    PersonLandmarks person;
    person.roi = roi;
    person.presence = double(presence[0]);
    const double c = std::cos(roi.rotation), s = std::sin(roi.rotation);
    for (size_t i = 0; i < landmark::kAll; ++i) {
        const float* p = &points[5 * i];
        double x = double(p[0]) / kLandmarkSide, y = double(p[1]) / kLandmarkSide;
        // A heat map's mean about the point, where it is sure of itself.
        const double column = x * kHeatSide, row = y * kHeatSide;
        if (column >= 0 && row >= 0 && column < kHeatSide && row < kHeatSide) {
            const int c0 = int(column), r0 = int(row);
            double sum = 0, sumX = 0, sumY = 0, most = 0;
            for (int r = std::max(r0 - 3, 0); r <= std::min(r0 + 3, kHeatSide - 1); ++r) {
                for (int k = std::max(c0 - 3, 0); k <= std::min(c0 + 3, kHeatSide - 1); ++k) {
                    const double v =
                        logistic(double(heat[(i * kHeatSide + size_t(r)) * kHeatSide + size_t(k)]));
                    sum += v;
                    sumX += v * k;
                    sumY += v * r;
                    most = std::max(most, v);
                }
            }
            if (most >= .5) {
                x = sumX / sum / kHeatSide;
                y = sumY / sum / kHeatSide;
            }
        }
        Landmark& point = person.points[i];
        const Point2 at = roi.toPicture({x, y});
        point.picture = {at[0], at[1], double(p[2]) / kLandmarkSide * roi.side};
        const double wx = double(world[3 * i]), wy = double(world[3 * i + 1]);
        point.world = {wx * c - wy * s, wx * s + wy * c, double(world[3 * i + 2])};
        point.visibility = logistic(double(p[3]));
        point.presence = logistic(double(p[4]));
    }
    person.mask = std::move(raw[2]);
    return person;
}

PersonLandmarks mirrored(const PersonLandmarks& person) {
    PersonLandmarks other = person;
    const double c = std::cos(person.roi.rotation), s = std::sin(person.roi.rotation);
    // Across the square changes its sign, along it does not.
    const auto reflect = [&](double& x, double& y) {
        const double across = -(x * c + y * s), along = y * c - x * s;
        x = across * c - along * s;
        y = across * s + along * c;
    };
    for (size_t i = 0; i < landmark::kAll; ++i) {
        Landmark& point = other.points[i];
        point = person.points[i < landmark::kCount ? oppositeLandmark(i) : i];
        double x = point.picture[0] - person.roi.centre[0],
               y = point.picture[1] - person.roi.centre[1];
        reflect(x, y);
        point.picture[0] = person.roi.centre[0] + x;
        point.picture[1] = person.roi.centre[1] + y;
        reflect(point.world[0], point.world[1]);
    }
    reverseRows(other.mask);
    return other;
}

}  // namespace doppel
