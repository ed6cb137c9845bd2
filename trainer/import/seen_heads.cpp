#include "trainer/import/seen_heads.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "engine/io/image.h"
#include "trainer/data/progress.h"
#include "trainer/person/body_start.h"
#include "trainer/person/face.h"
#include "trainer/person/heads.h"

namespace doppel {

namespace {

// Part of a body's farthest reach within which its middle and the person's lie in the picture.
constexpr double kNear = .5;

// Where the body stands in the picture: the pelvis, and how far its farthest joint is from it.
struct Place {
    Point2 middle{};
    double reach = 0;  // pixels
};

Place placeOf(const BodyModel& body, const Capture& capture, size_t frame) {
    std::array<double, 10> betas;
    std::ranges::copy(capture.betas, betas.begin());
    const std::vector<double> rest = restJoints(body, betas);
    const Camera& camera = capture.frames[frame].camera;
    std::array<glm::dquat, joint::kCount> turned;
    std::array<glm::dvec3, joint::kCount> at;
    const auto restAt = [&](size_t j) {
        return glm::dvec3(rest[3 * j], rest[3 * j + 1], rest[3 * j + 2]);
    };
    const Trans& trans = capture.trans[frame];
    Place place;
    for (size_t j = 0; j < joint::kCount; ++j) {
        const int parent = body.parents[j];
        const glm::dquat own = jointRotation(capture.theta[frame], j);
        turned[j] = parent < 0 ? own : turned[size_t(parent)] * own;
        at[j] = parent < 0 ? restAt(j) + glm::dvec3(trans[0], trans[1], trans[2])
                           : at[size_t(parent)] +
                                 turned[size_t(parent)] * (restAt(j) - restAt(size_t(parent)));
        if (!(at[j].z > 1e-3)) return {};
        const auto [u, v] = camera.project({at[j].x, at[j].y, at[j].z});
        if (j == 0) place.middle = {u, v};
        place.reach = std::max(place.reach, std::hypot(u - place.middle[0], v - place.middle[1]));
    }
    return place;
}

Point2 hipsOf(const PersonLandmarks& person) {
    const Point3 &left = person.points[landmark::kLeftHip].picture,
                 &right = person.points[landmark::kRightHip].picture;
    return {(left[0] + right[0]) / 2, (left[1] + right[1]) / 2};
}

// The person whose middle is nearest to the body's.
std::optional<PersonLandmarks> personAt(BlazePose& pose, const Image& picture, const Place& place) {
    const auto away = [&](const Point2& at) {
        return std::hypot(at[0] - place.middle[0], at[1] - place.middle[1]);
    };
    std::optional<Roi> nearest;
    for (const Detection& found : pose.detect(picture))
        if (!nearest || away(found.keypoints[0]) < away(nearest->centre)) nearest = found.roi();
    if (!nearest || !(away(nearest->centre) < kNear * place.reach)) return {};
    // Once more where the landmarks say that the person is.
    PersonLandmarks person = pose.landmarks(picture, *nearest);
    const auto point = [&](size_t i) {
        return Point2{person.points[i].picture[0], person.points[i].picture[1]};
    };
    const Roi closer = roiOfBody(point(landmark::kCentre), point(landmark::kScalePoint));
    if (!(person.presence > .5) || !(closer.side > 1)) return {};
    person = pose.net() == PoseNet::Heavy ? pose.landmarksBothWays(picture, closer)
                                          : pose.landmarks(picture, closer);
    if (!(person.presence > .5) || !(away(hipsOf(person)) < kNear * place.reach)) return {};
    return person;
}

}  // namespace

void takeSeenHeads(Capture& capture, const ImportRequest& request) {
    if (request.givenHeads || !request.device || !FaceFinder::isThere() ||
        !poseModelsAreThere(request.net))
        return;
    const BodyModel& body = *request.body;
    BlazePose pose(*request.device, request.net);
    FaceFinder faces(*request.device);
    const BodyPoser3d poser(body, capture.betas);
    std::vector<Theta> looks = capture.theta;
    size_t people = 0, seenFaces = 0;
    Progress progress("find the heads", int64_t(capture.size()));
    for (size_t f = 0; f < capture.size(); ++f) {
        if (interrupted()) throw Interrupted{};
        progress.update(int64_t(f) + 1);
        const Place place = placeOf(body, capture, f);
        if (!(place.reach > 1)) continue;
        const Image picture = readImage(capture.frames[f].image);
        const auto person = personAt(pose, picture, place);
        if (!person) continue;
        const auto face = faces(picture, *person);
        const Camera& camera = capture.frames[f].camera;
        looks[f] =
            poser(poser.atJoints(*person, camera), camera, face ? face->axes() : std::nullopt)
                .theta;
        ++people;
        if (face) ++seenFaces;
    }
    aimHeads(body, looks, capture.theta);
    capture.source["heads"] = fmt::format("as the face looks in {} frames of {}, by the ears in {}",
                                          seenFaces, capture.size(), people - seenFaces);
    if (people < capture.size())
        capture.source["heads"] += fmt::format(", as given in {}", capture.size() - people);
}

}  // namespace doppel
