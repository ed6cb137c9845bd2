#include "trainer/person/face.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "trainer/data/digest.h"
#include "trainer/person/picture_net.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

using glm::dvec3;

constexpr int kSide = 192;
constexpr double kLeastPresence = .5;
constexpr double kLeastSide = 24;  // pixels of the square, below which a face is a guess

fs::path networkFile(const fs::path& folder) { return folder / "face_landmark.tflite"; }

// The square about points, 1.5 times as wide as they are, upright as the eyes are.
Roi around(const std::vector<Point2>& points, double rotation) {
    const double c = std::cos(rotation), s = std::sin(rotation);
    double low[2] = {1e30, 1e30}, high[2] = {-1e30, -1e30};
    for (const Point2& p : points) {
        const double at[2] = {p[0] * c + p[1] * s, p[1] * c - p[0] * s};
        for (size_t k : {0u, 1u}) {
            low[k] = std::min(low[k], at[k]);
            high[k] = std::max(high[k], at[k]);
        }
    }
    const double x = (low[0] + high[0]) / 2, y = (low[1] + high[1]) / 2;
    return {{x * c - y * s, x * s + y * c},
            1.5 * std::max(high[0] - low[0], high[1] - low[1]),
            rotation};
}

// Where a face may be, from the body's landmarks: about eyes and mouth, and as wide as the head.
std::optional<Roi> faceRoi(const PersonLandmarks& person) {
    const auto at = [&](size_t i) {
        return glm::dvec2(person.points[i].picture[0], person.points[i].picture[1]);
    };
    const glm::dvec2 eyes = (at(landmark::kLeftEye) + at(landmark::kRightEye)) / 2.;
    const glm::dvec2 mouth = (at(landmark::kMouthLeft) + at(landmark::kMouthRight)) / 2.;
    const glm::dvec2 ears = (at(landmark::kLeftEar) + at(landmark::kRightEar)) / 2.;
    // Of a head that is seen from the front, the side or between, one of these is wide.
    const double size =
        std::max({glm::length(at(landmark::kLeftEar) - at(landmark::kRightEar)),
                  2.6 * glm::length(eyes - mouth), 1.5 * glm::length(at(landmark::kNose) - ears)});
    if (!(size > kLeastSide / 1.5)) return {};
    const glm::dvec2 down = mouth - eyes;
    const glm::dvec2 middle = eyes + .45 * down;
    const double rotation = glm::length(down) > 0 ? std::atan2(-down.x, down.y) : 0;
    return Roi{{middle.x, middle.y}, 1.6 * size, std::clamp(rotation, -.8, .8)};
}

}  // namespace

std::optional<glm::dmat3> FaceMesh::axes() const {
    const auto at = [&](size_t i) { return dvec3(points[i][0], points[i][1], points[i][2]); };
    // Outer corners of the eyes, sides of the face, corners of the mouth; forehead and chin.
    const dvec3 left = at(263) - at(33) + at(454) - at(234) + at(291) - at(61);
    const dvec3 up = at(10) - at(152);
    const dvec3 forward = glm::cross(left, up);
    if (!(glm::length(forward) > 1e-3 * glm::length(left) * glm::length(up))) return {};
    const dvec3 x = glm::normalize(left), z = glm::normalize(forward);
    return glm::dmat3(x, glm::cross(z, x), z);
}

SeenFace FaceMesh::seen() const {
    SeenFace face;
    for (const Point3& p : points)
        face.push_back(
            {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(presence)});
    return face;
}

FaceMesh faceOf(const std::vector<float>& points, float presence, const Roi& roi) {
    CHECK(points.size() == 3 * FaceMesh::kPoints, "a face has {} points", FaceMesh::kPoints);
    FaceMesh face;
    face.roi = roi;
    face.presence = 1 / (1 + std::exp(-double(presence)));
    for (size_t i = 0; i < FaceMesh::kPoints; ++i) {
        const float* p = &points[3 * i];
        const Point2 at = roi.toPicture({double(p[0]) / kSide, double(p[1]) / kSide});
        face.points[i] = {at[0], at[1], double(p[2]) / kSide * roi.side};
    }
    return face;
}

FaceFinder::FaceFinder(Device& device, fs::path folder)
    : device_(device), folder_(std::move(folder)) {}
FaceFinder::~FaceFinder() = default;

bool FaceFinder::isThere(const fs::path& folder) {
    std::error_code error;
    return fs::exists(networkFile(folder), error);
}

FaceMesh FaceFinder::look(const Image& rgb, const Roi& roi) {
    const std::vector<float> square = crop(rgb, roi, kSide, Outside::Black);
    FaceMesh face;
    const auto ask = [&] {
        if (!net_) {
            requireNetwork(networkFile(folder_));
            net_ = std::make_unique<PictureNet>(device_, networkFile(folder_), kSide,
                                                std::vector<int64_t>{3 * FaceMesh::kPoints, 1});
        }
        const auto raw = net_->run(square);
        face = faceOf(raw[0], raw[1][0], roi);
        AnswerLog::Answer bytes;
        append(bytes, face.presence);
        append(bytes, std::span<const Point3>(face.points));
        return bytes;
    };
    Digest question;
    question.addText("face");
    question.add(std::span<const float>(square));
    question.addValue(std::array{roi.centre[0], roi.centre[1], roi.side, roi.rotation});
    answer(
        log_, question,
        [&](std::span<const std::byte> kept) {
            face.roi = roi;
            return takeFront(kept, face.presence) &&
                   takeFront(kept, std::span<Point3>(face.points)) && kept.empty();
        },
        ask);
    return face;
}

std::optional<FaceMesh> FaceFinder::operator()(const Image& rgb, const PersonLandmarks& person) {
    std::optional<Roi> roi = faceRoi(person);
    std::optional<FaceMesh> face;
    // The square that the network was trained on lies about its own points.
    for (int turn = 0; turn < 3 && roi; ++turn) {
        face = look(rgb, *roi);
        if (!(face->presence > kLeastPresence)) return {};
        std::vector<Point2> points;
        for (const Point3& p : face->points) points.push_back({p[0], p[1]});
        // Upright as forehead and chin are, which a profile shows as well.
        const Point3 &top = face->points[10], &chin = face->points[152];
        roi = around(points, std::atan2(top[0] - chin[0], chin[1] - top[1]));
        if (!(roi->side > kLeastSide)) return {};
    }
    return face;
}

}  // namespace doppel
