// ROMP and BEV (Sun et al., ICCV 2021 and CVPR 2022), as the package simple-romp saves them: an npz
// with a dict `results`, of one picture or by pictures (video_results.npz). People are rows.
#include <algorithm>
#include <map>
#include <tuple>

#include "engine/error.h"
#include "engine/files/printable.h"
#include "trainer/motion/estimates/fields.h"

namespace doppel {

namespace {

// cam_trans stands before a camera that sees 60° along the picture's longer side.
constexpr double kFocal = 443.4 / 512;

// The object in a 0-d array of objects.
std::optional<PickleValue> resultsOf(const EstimateSource& source) {
    const Array* array = source.npz ? source.npz->find("results") : nullptr;
    if (array == nullptr || array->descr != "|O" || array->bytes.empty()) return {};
    const PickleValue value = pickleFromBytes(array->bytes, array->where);
    if (value.kind() != PickleValue::Kind::list || value.size() != 1) return {};
    PickleValue dict = value.item(0);
    if (dict.kind() != PickleValue::Kind::dict) return {};
    return dict;
}

bool isPicture(const PickleValue& dict) { return dict.has("smpl_thetas") && dict.has("cam"); }

bool isRomp(const EstimateSource& source) {
    const auto dict = resultsOf(source);
    if (!dict || dict->size() == 0) return false;
    if (isPicture(*dict)) return true;
    const PickleValue first = dict->at(dict->keys()[0]);
    return first.kind() == PickleValue::Kind::dict && isPicture(first);
}

// metres: whether the views by cam_trans are among them.
void readPicture(const PickleValue& frame, int64_t picture, const std::string& name, bool metres,
                 std::map<int64_t, EstimatedPerson>& people) {
    const Rotations thetas = rotationsOf(frame.at("smpl_thetas").asArray(), joint::kCount);
    const size_t count = thetas.size();
    const Rows cam = rowsOf(frame.at("cam").asArray(), 3, count);
    std::optional<Rows> trans;
    if (metres) trans = rowsOf(frame.at("cam_trans").asArray(), 3, count);
    std::vector<int64_t> ids;
    if (const auto value = frame.find("track_ids"))
        ids = pictureNumbers(value->asArray(), count);
    else
        for (size_t i = 0; i < count; ++i) ids.push_back(static_cast<int64_t>(i));
    for (size_t i = 0; i < count; ++i) {
        EstimatedPose pose;
        pose.picture = picture;
        pose.name = name;
        setRotations(pose.theta, 0,
                     std::span(thetas.values).subspan(i * joint::kCount, joint::kCount));
        // Of the two ways to say it cam is what the network gives. Newer versions bring the hips
        // to the origin.
        for (const bool weak : {true, false})
            for (const bool hips : {false, true}) {
                if (!weak && !trans) continue;
                EstimatedView view;
                const glm::dvec3 rest = hips ? glm::dvec3(0) : restPelvis();
                if (weak) {
                    view.kind = EstimatedView::Kind::Square;
                    view.scale = cam[i][0];
                    // Here the offset is in half sides: u = s x + t.
                    if (cam[i][0] > 0)
                        view.pelvis = rest + glm::dvec3(cam[i][1], cam[i][2], 0) / cam[i][0];
                } else {
                    view.kind = EstimatedView::Kind::Metres;
                    view.pelvis = rest + glm::dvec3((*trans)[i][0], (*trans)[i][1], (*trans)[i][2]);
                    view.of = EstimatedView::Focal::Longest;
                    view.focal = kFocal;
                }
                pose.views.push_back(view);
            }
        people[ids[i]].poses.push_back(std::move(pose));
    }
}

void readRomp(EstimateSource& source, Estimates& estimates) {
    std::map<int64_t, EstimatedPerson> people;
    const PickleValue results = *resultsOf(source);
    // Pictures with people: their number, name and content.
    std::vector<std::tuple<int64_t, std::string, PickleValue>> pictures;
    if (isPicture(results)) {
        pictures.emplace_back(0, pictureStem(source.path.filename().string()), results);
    } else {
        int64_t number = 0;
        results.eachPair([&](const std::string& name, const PickleValue& frame) {
            // A picture in which nobody was found holds nothing.
            if (frame.kind() == PickleValue::Kind::dict && frame.size() > 0)
                pictures.emplace_back(number, pictureStem(name), frame);
            ++number;
        });
    }
    estimates.readings = {"cam, about SMPL's origin", "cam, about the hips"};
    const bool metres = std::ranges::all_of(
        pictures, [](const auto& picture) { return std::get<2>(picture).has("cam_trans"); });
    if (metres)
        estimates.readings.insert(estimates.readings.end(),
                                  {"cam_trans, about SMPL's origin", "cam_trans, about the hips"});
    for (const auto& [number, name, frame] : pictures)
        readPicture(frame, number, name, metres, people);
    for (auto& [id, person] : people) {
        person.name = std::to_string(id);
        estimates.people.push_back(std::move(person));
    }
}

const EstimateFormat kRomp{{
    .program = "ROMP",
    .looks = "ROMP's video_results.npz",
    .recognises = isRomp,
    .read = readRomp,
}};

}  // namespace

}  // namespace doppel
