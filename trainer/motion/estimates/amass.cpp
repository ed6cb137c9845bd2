// Motions as AMASS (Mahmood et al., ICCV 2019) and its like keep them: poses [F, 3 J] of SMPL,
// SMPL+H or SMPL-X and trans [F,3], in an npz with the rate; the same parameters by parts
// (root_orient, pose_body); and AIST++'s pickles (smpl_poses, smpl_trans).
#include <algorithm>

#include "engine/error.h"
#include "trainer/data/capture_notes.h"
#include "trainer/motion/estimates/fields.h"

namespace doppel {

namespace {

constexpr size_t kBodyJoints = 22;  // with the pelvis, without hands and face

const Array* firstOf(const Npz& npz, std::initializer_list<const char*> names) {
    for (const char* name : names)
        if (const Array* array = npz.find(name)) return array;
    return nullptr;
}

// SMPL has two joints for hands where SMPL+H and SMPL-X go on with fingers or the jaw.
Rotations bodyOf(const Array& poses) {
    const bool smpl = poses.shape.size() == 2 && poses.shape[1] == int64_t(3 * joint::kCount);
    return firstRotationsOf(poses, smpl ? joint::kCount : kBodyJoints);
}

void readAmass(EstimateSource& source, Estimates& estimates) {
    EstimatedPerson person;
    person.name = "1";
    Rotations body;
    Rows trans;
    bool expressive = false;  // SMPL-X
    double unit = 1;
    if (source.pickle) {
        body = bodyOf(source.pickle->at("smpl_poses").asArray());
        trans = rowsOf(source.pickle->at("smpl_trans").asArray(), 3, body.size());
        if (const auto scaling = source.pickle->find("smpl_scaling")) unit = scaling->asNumber();
        if (!(unit > 0) || !(unit < 1e6))
            throwInput("{}: smpl_scaling: expected units per metre, found {}", source.path.string(),
                       unit);
        estimates.fps = 60;  // all of AIST++
    } else {
        const Npz& npz = *source.npz;
        if (const Array* poses = npz.find("poses")) {
            body = bodyOf(*poses);
            expressive = poses->shape[1] == 165;
        } else {
            const Rotations root = rotationsOf(npz.at("root_orient"), 1);
            const Rotations rest =
                firstRotationsOf(npz.at("pose_body"), kBodyJoints - 1, root.size());
            body.joints = kBodyJoints;
            for (size_t i = 0; i < root.size(); ++i) {
                body.values.push_back(root.values[i]);
                const auto row = std::span(rest.values).subspan(i * rest.joints, rest.joints);
                body.values.insert(body.values.end(), row.begin(), row.end());
            }
        }
        const Array* moved = firstOf(npz, {"trans", "transl"});
        trans = rowsOf(moved != nullptr ? *moved : npz.at("trans"), 3, body.size());
        if (const Array* rate = firstOf(npz, {"mocap_frame_rate", "mocap_framerate", "fps"}))
            estimates.fps = checkedFps(rate->scalar(), rate->where);
        if (const Array* model = npz.find("surface_model_type"))
            expressive = model->toText() == "smplx";
        expressive = expressive || npz.has("pose_jaw");
        if (const Array* betas = npz.find("betas"); betas != nullptr && betas->count() > 0) {
            Array row = *betas;
            if (row.shape.size() == 1) row.shape = {1, row.count()};
            const auto wide = static_cast<size_t>(row.count() / std::max<int64_t>(row.shape[0], 1));
            person.betas = meanBetas(rowsOf(row, wide));
        }
    }
    if (expressive) person.shape = ShapeSpace::SmplX;
    const glm::dvec3 rest = expressive ? smplxPelvis() : restPelvis();
    // Of a clip's person such files are in camera space, with its axes or with y up.
    estimates.readings = {"in camera space", "in camera space with y up",
                          "turned as in camera space; placed by the masks",
                          "turned as in camera space with y up; placed by the masks"};
    const glm::dquat half(0, 1, 0, 0);  // about x
    person.poses.resize(body.size());
    for (size_t i = 0; i < body.size(); ++i) {
        EstimatedPose& pose = person.poses[i];
        pose.picture = static_cast<int64_t>(i);
        setRotations(pose.theta, 0, std::span(body.values).subspan(i * body.joints, body.joints));
        const glm::dvec3 place = rest + glm::dvec3(trans[i][0], trans[i][1], trans[i][2]) / unit;
        pose.views.resize(4);
        for (const size_t up : {0u, 1u}) {
            EstimatedView& placed = pose.views[up];
            placed.kind = EstimatedView::Kind::Metres;
            if (up) placed.turn = pose.views[2 + up].turn = half;
            placed.pelvis = placed.turn * place;
        }
        auto& world = pose.world.emplace();
        world.theta = pose.theta;
        for (int c = 0; c < 3; ++c)
            world.trans[static_cast<size_t>(c)] = static_cast<float>(place[c] - restPelvis()[c]);
    }
    estimates.people.push_back(std::move(person));
}

const EstimateFormat kAmass{{
    .program = "AMASS",
    .looks = "AMASS's npz (poses, trans)",
    .measured = true,
    .recognises =
        [](const EstimateSource& source) {
            if (source.pickle)
                return source.pickle->kind() == PickleValue::Kind::dict &&
                       source.pickle->has("smpl_poses") && source.pickle->has("smpl_trans");
            return source.npz &&
                   (source.npz->has("poses") ||
                    (source.npz->has("root_orient") && source.npz->has("pose_body"))) &&
                   (source.npz->has("trans") || source.npz->has("transl"));
        },
    .read = readAmass,
}};

}  // namespace

}  // namespace doppel
