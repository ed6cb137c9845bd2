#include "trainer/import/seen_heads.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "engine/io/image.h"
#include "trainer/data/body_render.h"
#include "trainer/data/progress.h"
#include "trainer/person/body_start.h"
#include "trainer/person/face.h"
#include "trainer/person/heads.h"

namespace doppel {

namespace {

// Part of a body's farthest reach within which its middle and the person's lie in the picture.
constexpr double kNear = .5;

// Where the body stands in the picture: the pelvis, and how far its farthest joint is from it; a
// reach of 0 where part of it is behind the camera.
struct Place {
    Point2 middle{};
    double reach = 0;  // pixels
};

Place placeOf(const PosedMesh& body, const Camera& camera) {
    Place place;
    place.middle = camera.project(body.joints[joint::kPelvis]);
    for (const auto& at : body.joints) {
        if (!(at[2] > 1e-3)) return {};
        const auto [u, v] = camera.project(at);
        place.reach = std::max(place.reach, std::hypot(u - place.middle[0], v - place.middle[1]));
    }
    return place;
}

// The person whose middle is nearest to the body's.
std::optional<PersonLandmarks> personAt(BlazePose& pose, const Image& picture, const Place& place) {
    const auto away = [&](const Roi& roi) {
        return std::hypot(roi.centre[0] - place.middle[0], roi.centre[1] - place.middle[1]);
    };
    std::optional<Roi> nearest;
    for (const Detection& found : pose.detect(picture))
        if (!nearest || away(found.roi()) < away(*nearest)) nearest = found.roi();
    if (!nearest || !(away(*nearest) < kNear * place.reach)) return {};
    PersonLandmarks person = pose.landmarks(picture, *nearest);
    if (!(person.presence > .5)) return {};
    return person;
}

}  // namespace

void takeSeenHeads(Capture& capture, const ImportRequest& request) {
    if (!request.device || !FaceFinder::isThere() || !poseModelsAreThere(request.net)) return;
    const BodyModel& body = *request.body;
    BlazePose pose(*request.device, request.net);
    FaceFinder faces(*request.device);
    BodyPoser bodies(*request.device, body);
    const BodyPoser3d poser(body, capture.betas);
    std::vector<Theta> looks = capture.theta;
    capture.faces.assign(capture.size(), {});
    size_t people = 0, seenFaces = 0;
    Progress progress("find the heads", int64_t(capture.size()));
    for (size_t f = 0; f < capture.size(); ++f) {
        if (interrupted()) throw Interrupted{};
        progress.update(int64_t(f) + 1);
        const Camera& camera = capture.frames[f].camera;
        const Place place =
            placeOf(bodies.pose(capture.theta[f], capture.trans[f], capture.betas), camera);
        if (!(place.reach > 1)) continue;
        const Image picture = readImage(capture.frames[f].image);
        const auto person = personAt(pose, picture, place);
        if (!person) continue;
        const auto face = faces(picture, *person);
        looks[f] =
            poser(poser.atJoints(*person, camera), camera, face ? face->axes() : std::nullopt)
                .theta;
        ++people;
        if (!face) continue;
        ++seenFaces;
        capture.faces[f] = face->seen();
    }
    if (request.givenHeads) return;
    aimHeads(body, looks, capture.theta);
    capture.source["heads"] = fmt::format("as the face looks in {} frames of {}, by the ears in {}",
                                          seenFaces, capture.size(), people - seenFaces);
    if (people < capture.size())
        capture.source["heads"] += fmt::format(", as given in {}", capture.size() - people);
}

}  // namespace doppel
