// 4D-Humans' tracks (Goel, Pavlakos, Rajasegaran, Kanazawa and Malik, ICCV 2023), as PHALP writes
// them: a dict by picture, each with lists over the people that are tracked there.
#include <cmath>
#include <map>

#include "engine/error.h"
#include "engine/files/printable.h"
#include "trainer/motion/estimates/fields.h"

namespace doppel {

namespace {

// PHALP draws squares of 256 pixels, whose cameras have a focal length of 5000.
constexpr double kFocal = 5000. / 256;

void readPhalp(EstimateSource& source, Estimates& estimates) {
    estimates.readings = {""};
    std::map<int64_t, EstimatedPerson> people;
    std::map<int64_t, std::vector<Betas>> betas;
    size_t pictures = 0;
    source.pickle->eachPair([&](const std::string& picture, const PickleValue& frame) {
        ++pictures;
        const PickleValue ids = frame.at("tid"), bodies = frame.at("smpl"),
                          cameras = frame.at("camera");
        const auto missed = frame.find("tracked_time");
        if (bodies.size() != ids.size() || cameras.size() != ids.size() ||
            (missed && missed->size() != ids.size()))
            throwInput("{}: expected as many smpl and camera as tid, {}, found {} and {}",
                       frame.where(), ids.size(), bodies.size(), cameras.size());
        const double time = frame.at("time").asNumber();
        if (!(time >= 0) || time > 1e9 || time != std::floor(time))
            throwInput("{}: time: expected the picture's number, from 0, found {}", frame.where(),
                       time);
        for (size_t i = 0; i < ids.size(); ++i) {
            // A track that was not seen in this picture repeats what it was before.
            if (missed && missed->item(i).asNumber() > 0) continue;
            const PickleValue body = bodies.item(i);
            if (body.kind() != PickleValue::Kind::dict) continue;
            EstimatedPose pose;
            pose.picture = static_cast<int64_t>(time);
            pose.name = pictureStem(picture);
            Array root = body.at("global_orient").asArray(), rest = body.at("body_pose").asArray();
            root.shape.insert(root.shape.begin(), 1);
            rest.shape.insert(rest.shape.begin(), 1);
            setRotations(pose.theta, 0, rotationsOf(root, 1, 1).values);
            setRotations(pose.theta, 1, rotationsOf(rest, joint::kCount - 1, 1).values);
            Array place = cameras.item(i).asArray();
            place.shape = {1, place.count()};
            const Rows at = rowsOf(place, 3, 1);
            EstimatedView view;
            view.kind = EstimatedView::Kind::Metres;
            view.pelvis = restPelvis() + glm::dvec3(at[0][0], at[0][1], at[0][2]);
            view.of = EstimatedView::Focal::Longest;
            view.focal = kFocal;
            view.nominal = true;
            pose.views = {view};
            const int64_t id = ids.item(i).asInteger();
            if (const auto shape = body.find("betas")) {
                Array row = shape->asArray();
                row.shape = {1, row.count()};
                betas[id].push_back(*meanBetas(rowsOf(row, 10, 1)));
            }
            people[id].poses.push_back(std::move(pose));
        }
    });
    for (auto& [id, person] : people) {
        person.name = std::to_string(id);
        if (const auto& all = betas[id]; !all.empty()) {
            person.betas.emplace();
            for (size_t k = 0; k < person.betas->size(); ++k)
                for (const Betas& one : all)
                    (*person.betas)[k] += one[k] / static_cast<float>(all.size());
        }
        estimates.people.push_back(std::move(person));
    }
    if (estimates.people.empty())
        throwInput("{}: expected one person or more, found nobody in {} pictures",
                   source.path.string(), pictures);
}

const EstimateFormat kPhalp{{
    .program = "4D-Humans",
    .looks = "4D-Humans' demo_NAME.pkl",
    .recognises =
        [](const EstimateSource& source) {
            if (!source.pickle || source.pickle->kind() != PickleValue::Kind::dict) return false;
            const auto keys = source.pickle->keys();
            if (keys.empty()) return false;
            const PickleValue first = source.pickle->at(keys[0]);
            return first.kind() == PickleValue::Kind::dict && first.has("tid") &&
                   first.has("smpl") && first.has("camera");
        },
    .read = readPhalp,
}};

}  // namespace

}  // namespace doppel
