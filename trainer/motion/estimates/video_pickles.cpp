// Pickles of dicts by person: VIBE (Kocabas, Athanasiou and Black, CVPR 2020) and what builds on it
// (TCMR, PARE's videos), and WHAM (Shin, Kim, Halilaj and Black, CVPR 2024).
#include "engine/error.h"
#include "engine/files/printable.h"
#include "trainer/motion/estimates/fields.h"

namespace doppel {

namespace {

// The first of the dicts by person; nothing where it is no such pickle.
std::optional<PickleValue> firstPerson(const EstimateSource& source) {
    if (!source.pickle || source.pickle->kind() != PickleValue::Kind::dict) return {};
    const auto keys = source.pickle->keys();
    if (keys.empty()) return {};
    const PickleValue first = source.pickle->at(keys[0]);
    if (first.kind() != PickleValue::Kind::dict) return {};
    return first;
}

template <typename Read>
void readPeople(const EstimateSource& source, Estimates& estimates, Read read) {
    source.pickle->eachPair([&](const std::string& name, const PickleValue& dict) {
        EstimatedPerson person;
        person.name = printable(name);
        if (dict.kind() == PickleValue::Kind::dict && dict.size() == 0) return;
        read(dict, person);
        estimates.people.push_back(std::move(person));
    });
    if (estimates.people.empty())
        throwInput("{}: expected one person or more, found none", source.path.string());
}

std::vector<EstimatedPose> posesFrom(const PickleValue& dict) {
    const Rotations pose = rotationsOf(dict.at("pose").asArray(), joint::kCount);
    const char* name = dict.has("frame_ids") ? "frame_ids" : "frame_id";
    const auto pictures = pictureNumbers(dict.at(name).asArray(), pose.size());
    std::vector<EstimatedPose> poses(pose.size());
    for (size_t i = 0; i < poses.size(); ++i) {
        poses[i].picture = pictures[i];
        setRotations(poses[i].theta, 0,
                     std::span(pose.values).subspan(i * joint::kCount, joint::kCount));
    }
    return poses;
}

// ---- VIBE ---------------------------------------------------------------------------------------

// pred_cam [F,3] is s, tx, ty of the square that the network saw, bboxes [F,4] its centre, width
// and height. Some of the trackers that come with it give the person's box, which is enlarged
// before the network sees it, others the square itself.
void readVibe(EstimateSource& source, Estimates& estimates) {
    estimates.readings = {"boxes as they are", "boxes enlarged by a tenth"};
    readPeople(source, estimates, [](const PickleValue& dict, EstimatedPerson& person) {
        person.poses = posesFrom(dict);
        const size_t count = person.poses.size();
        const Rows camera = rowsOf(dict.at("pred_cam").asArray(), 3, count);
        const Rows boxes = rowsOf(dict.at("bboxes").asArray(), 4, count);
        if (const auto betas = dict.find("betas"))
            person.betas = meanBetas(rowsOf(betas->asArray(), 10, count));
        for (size_t i = 0; i < count; ++i)
            for (const double enlarged : {1., 1.1}) {
                EstimatedView view;
                view.kind = EstimatedView::Kind::Square;
                view.scale = camera[i][0];
                view.pelvis = restPelvis() + glm::dvec3(camera[i][1], camera[i][2], 0);
                view.centre = {boxes[i][0], boxes[i][1]};
                view.side = enlarged * std::max(boxes[i][2], boxes[i][3]);
                if (!(view.side > 0))
                    throwInput("{}: expected boxes of some size, found {} in row {}", boxes.where,
                               view.side, i);
                person.poses[i].views.push_back(view);
            }
    });
}

const EstimateFormat kVibe{{
    .program = "VIBE",
    .looks = "VIBE's vibe_output.pkl",
    .recognises =
        [](const EstimateSource& source) {
            const auto person = firstPerson(source);
            return person && person->has("pose") && person->has("pred_cam") &&
                   person->has("bboxes");
        },
    .read = readVibe,
}};

// ---- WHAM ---------------------------------------------------------------------------------------

// pose and trans are in camera space, before a camera whose focal length is the picture's diagonal;
// pose_world and trans_world in a world with y up.
void readWham(EstimateSource& source, Estimates& estimates) {
    estimates.readings = {""};
    readPeople(source, estimates, [](const PickleValue& dict, EstimatedPerson& person) {
        person.poses = posesFrom(dict);
        const size_t count = person.poses.size();
        const Rows trans = rowsOf(dict.at("trans").asArray(), 3, count);
        if (const auto betas = dict.find("betas"))
            person.betas = meanBetas(rowsOf(betas->asArray(), 10, count));
        for (size_t i = 0; i < count; ++i) {
            EstimatedView view;
            view.kind = EstimatedView::Kind::Metres;
            view.pelvis = restPelvis() + glm::dvec3(trans[i][0], trans[i][1], trans[i][2]);
            view.of = EstimatedView::Focal::Diagonal;
            view.focal = 1;
            person.poses[i].views = {view};
        }
        if (!dict.has("pose_world") || !dict.has("trans_world")) return;
        const Rotations world = rotationsOf(dict.at("pose_world").asArray(), joint::kCount, count);
        const Rows path = rowsOf(dict.at("trans_world").asArray(), 3, count);
        for (size_t i = 0; i < count; ++i) {
            auto& pose = person.poses[i].world.emplace();
            setRotations(pose.theta, 0,
                         std::span(world.values).subspan(i * joint::kCount, joint::kCount));
            for (size_t c = 0; c < 3; ++c) pose.trans[c] = static_cast<float>(path[i][c]);
        }
    });
}

const EstimateFormat kWham{{
    .program = "WHAM",
    .looks = "WHAM's wham_output.pkl",
    .recognises =
        [](const EstimateSource& source) {
            const auto person = firstPerson(source);
            return person && person->has("pose") && person->has("trans") &&
                   (person->has("frame_ids") || person->has("frame_id"));
        },
    .read = readWham,
}};

}  // namespace

}  // namespace doppel
