// SPIN (Kolotouros, Pavlakos, Black and Daniilidis, ICCV 2019): its evaluation's npz (pose, betas,
// camera), its fits (imgname, center, scale, pose), or a pickle of the same names; and SPIN's poses
// as the Human Retargeting dataset keeps them, a pickle per picture with pose, trans and f.
#include <algorithm>

#include "engine/error.h"
#include "engine/files/ending.h"
#include "trainer/data/frame_selection.h"
#include "trainer/motion/estimates/fields.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// Arrays by name of an npz or of a pickled dict.
std::optional<Array> fieldOf(const EstimateSource& source,
                             std::initializer_list<const char*> names) {
    for (const char* name : names) {
        if (source.npz) {
            if (const Array* array = source.npz->find(name)) return *array;
        } else if (source.pickle && source.pickle->kind() == PickleValue::Kind::dict) {
            if (const auto value = source.pickle->find(name)) return value->asArray();
        }
    }
    return {};
}

bool hasField(const EstimateSource& source, const char* name) {
    if (source.npz) return source.npz->has(name);
    return source.pickle && source.pickle->kind() == PickleValue::Kind::dict &&
           source.pickle->has(name);
}

// ---- all pictures in one file -------------------------------------------------------------------

void readSpin(EstimateSource& source, Estimates& estimates) {
    const auto posed = fieldOf(source, {"pose", "pred_rotmat", "rotmat"});
    const Rotations pose = rotationsOf(*posed, joint::kCount);
    const size_t count = pose.size();
    const auto camera = fieldOf(source, {"camera", "pred_camera", "pred_cam"});
    const auto centre = fieldOf(source, {"center"}), scale = fieldOf(source, {"scale"});
    const auto boxes = fieldOf(source, {"bboxes", "bbox"});
    EstimatedPerson person;
    person.name = "1";
    if (const auto betas = fieldOf(source, {"betas", "pred_betas", "shape"}))
        person.betas = meanBetas(rowsOf(*betas, 10, count));
    std::vector<int64_t> pictures;
    if (const auto numbers = fieldOf(source, {"frame_ids"}))
        pictures = pictureNumbers(*numbers, count);
    person.poses.resize(count);
    for (size_t i = 0; i < count; ++i) {
        EstimatedPose& one = person.poses[i];
        one.picture = pictures.empty() ? static_cast<int64_t>(i) : pictures[i];
        setRotations(one.theta, 0,
                     std::span(pose.values).subspan(i * joint::kCount, joint::kCount));
    }
    // The square that the network saw: centre and side, in the dataset's unit of 200 pixels or as
    // a box with its centre.
    const bool squares = camera && ((centre && scale) || boxes);
    if (!squares) {
        estimates.readings = {"no camera; placed by the masks"};
        for (EstimatedPose& one : person.poses) one.views.resize(1), one.views[0].nominal = true;
    } else {
        const Rows cam = rowsOf(*camera, 3, count);
        const bool dataset = centre && scale;
        const Rows middles = dataset ? rowsOf(*centre, 2, count) : rowsOf(*boxes, 4, count);
        const Rows sizes = dataset ? rowsOf(*scale, 1, count) : rowsOf(*boxes, 4, count);
        estimates.readings = {dataset ? "squares of center and scale" : "boxes as they are",
                              "squares enlarged by a fifth"};
        for (size_t i = 0; i < count; ++i)
            for (const double enlarged : {1., 1.2}) {
                EstimatedView view;
                view.kind = EstimatedView::Kind::Square;
                view.scale = cam[i][0];
                view.pelvis = restPelvis() + glm::dvec3(cam[i][1], cam[i][2], 0);
                view.centre = {middles[i][0], middles[i][1]};
                view.side =
                    enlarged * (dataset ? 200 * sizes[i][0] : std::max(sizes[i][2], sizes[i][3]));
                if (!(view.side > 0))
                    throwInput("{}: expected squares of some size, found {} in row {}", sizes.where,
                               view.side, i);
                person.poses[i].views.push_back(view);
            }
    }
    estimates.people.push_back(std::move(person));
}

const EstimateFormat kSpin{{
    .program = "SPIN",
    .looks = "SPIN's npz or pickle (pose, camera)",
    .recognises =
        [](const EstimateSource& source) {
            const bool posed = hasField(source, "pose") || hasField(source, "pred_rotmat") ||
                               hasField(source, "rotmat");
            return posed && !hasField(source, "trans") &&
                   (hasField(source, "camera") || hasField(source, "pred_camera") ||
                    hasField(source, "pred_cam") || hasField(source, "center"));
        },
    .read = readSpin,
}};

// ---- a pickle per picture -----------------------------------------------------------------------

bool isOfPicture(const PickleValue& value) {
    return value.kind() == PickleValue::Kind::dict && value.has("pose") && value.has("trans") &&
           value.has("f");
}

std::vector<fs::path> picklesOf(const fs::path& folder) {
    std::vector<fs::path> files;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error))
        if (endingOf(entry.path()) == ".pkl" && !entry.path().filename().string().starts_with('.'))
            files.push_back(entry.path());
    std::ranges::sort(files, [](const fs::path& a, const fs::path& b) {
        return naturallyBefore(a.filename().string(), b.filename().string());
    });
    return files;
}

// "X.jpg_body.pkl" and "X_IUV.png_body.pkl" are of the picture X.jpg.
std::string pictureOf(const fs::path& file) {
    std::string name = file.stem().string();
    for (const std::string_view end : {"_body", ".png", ".jpg", "_IUV"})
        if (name.ends_with(end)) name.erase(name.size() - end.size());
    return name;
}

EstimatedPose poseOf(const PickleValue& value, std::optional<Betas>& betas) {
    EstimatedPose pose;
    const auto row = [&](const char* name) {
        Array array = value.at(name).asArray();
        array.shape.insert(array.shape.begin(), 1);
        return array;
    };
    setRotations(pose.theta, 0, rotationsOf(row("pose"), joint::kCount, 1).values);
    const Rows trans = rowsOf(row("trans"), 3, 1);
    const double focal = value.at("f").asNumber();
    if (!(focal > 0) || !(focal < 1e7))
        throwInput("{}: f: expected a focal length in pixels, found {}", value.where(), focal);
    if (value.has("betas")) betas = meanBetas(rowsOf(row("betas"), 10, 1));
    EstimatedView view;
    view.kind = EstimatedView::Kind::Metres;
    view.pelvis = restPelvis() + glm::dvec3(trans[0][0], trans[0][1], trans[0][2]);
    view.of = EstimatedView::Focal::Pixels;
    view.focal = focal;
    pose.views = {view};
    return pose;
}

void readPictures(EstimateSource& source, Estimates& estimates) {
    estimates.readings = {""};
    EstimatedPerson person;
    person.name = "1";
    if (source.folder) {
        int64_t number = 0;
        for (const fs::path& file : picklesOf(source.path)) {
            const PickleValue value = readPickle(file);
            if (value.kind() != PickleValue::Kind::dict)
                throwInput("{}: expected a dict with pose, trans and f, found another value",
                           file.string());
            EstimatedPose pose = poseOf(value, person.betas);
            pose.picture = number++;
            pose.name = pictureOf(file);
            person.poses.push_back(std::move(pose));
        }
    } else {
        person.poses.push_back(poseOf(*source.pickle, person.betas));
        person.poses.back().name = pictureOf(source.path);
    }
    estimates.people.push_back(std::move(person));
}

const EstimateFormat kPictures{{
    .program = "SPIN",
    .looks = "a folder of SPIN's pickles (pose, trans, f)",
    .recognises =
        [](const EstimateSource& source) {
            if (source.pickle) return isOfPicture(*source.pickle);
            if (!source.folder) return false;
            const auto files = picklesOf(source.path);
            return !files.empty() && isOfPicture(readPickle(files[0]));
        },
    .read = readPictures,
}};

}  // namespace

}  // namespace doppel
