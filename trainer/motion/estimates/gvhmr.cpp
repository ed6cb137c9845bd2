// GVHMR (Shen et al., SIGGRAPH Asia 2024): hmr4d_results.pt, tensors of SMPL-X's parameters in
// camera space and in a world with y up. An npz of the same names is taken as well.
#include "engine/error.h"
#include "trainer/motion/estimates/fields.h"

namespace doppel {

namespace {

constexpr size_t kBodyJoints = 21;  // SMPL-X's without pelvis, hands and face

// One field's rows: "smpl_params_incam", "transl" of the file, or of an npz
// "smpl_params_incam/transl", as programs flatten it.
Rows field(EstimateSource& source, const char* group, const char* name, size_t width, size_t rows) {
    if (source.torch) {
        PickleValue value = source.torch->root().at(group);
        if (*name != '\0') value = value.at(name);
        const auto tensor = source.torch->tensor(value);
        if (!tensor) throwInput("{}: expected a tensor of floats, found none", value.where());
        return rowsOf(*tensor, value.where(), width, rows);
    }
    const std::string slash = *name != '\0' ? fmt::format("{}/{}", group, name) : group;
    const std::string underscores = *name != '\0' ? fmt::format("{}_{}", group, name) : group;
    const Array* array = source.npz->find(slash);
    return rowsOf(array != nullptr ? *array : source.npz->at(underscores), width, rows);
}

Theta thetaOf(const Rows& orient, const Rows& body, size_t i) {
    Theta theta{};
    for (size_t k = 0; k < 3; ++k) theta[k] = static_cast<float>(orient[i][k]);
    for (size_t k = 0; k < 3 * kBodyJoints; ++k) theta[3 + k] = static_cast<float>(body[i][k]);
    return theta;
}

void readGvhmr(EstimateSource& source, Estimates& estimates) {
    estimates.readings = {""};
    EstimatedPerson person;
    person.name = "1";
    const auto params = [&](const char* group, const char* name, size_t width, size_t rows) {
        return field(source, group, name, width, rows);
    };
    const Rows orient = params("smpl_params_incam", "global_orient", 3, 0);
    const size_t count = orient.size();
    const Rows body = params("smpl_params_incam", "body_pose", 3 * kBodyJoints, count);
    const Rows transl = params("smpl_params_incam", "transl", 3, count);
    const Rows intrinsics = field(source, "K_fullimg", "", 9, count);
    person.betas = meanBetas(params("smpl_params_incam", "betas", 10, count));
    person.shape = ShapeSpace::SmplX;
    for (size_t i = 0; i < count; ++i) {
        const auto k = intrinsics[i];
        if (!(k[0] > 0) || !(k[4] > 0))
            throwInput("{}: expected focal lengths in pixels, found {} and {} in row {}",
                       intrinsics.where, k[0], k[4], i);
        EstimatedPose pose;
        pose.picture = static_cast<int64_t>(i);
        pose.theta = thetaOf(orient, body, i);
        EstimatedView view;
        view.kind = EstimatedView::Kind::Metres;
        view.pelvis = smplxPelvis() + glm::dvec3(transl[i][0], transl[i][1], transl[i][2]);
        view.of = EstimatedView::Focal::Pixels;
        view.focal = (k[0] + k[4]) / 2;
        view.principal = glm::dvec2(k[2], k[5]);
        pose.views = {view};
        person.poses.push_back(std::move(pose));
    }
    const Rows worldOrient = params("smpl_params_global", "global_orient", 3, count);
    const Rows worldBody = params("smpl_params_global", "body_pose", 3 * kBodyJoints, count);
    const Rows path = params("smpl_params_global", "transl", 3, count);
    const glm::dvec3 higher = smplxPelvis() - restPelvis();
    for (size_t i = 0; i < count; ++i) {
        auto& world = person.poses[i].world.emplace();
        world.theta = thetaOf(worldOrient, worldBody, i);
        for (size_t c = 0; c < 3; ++c)
            world.trans[c] = static_cast<float>(path[i][c] + higher[static_cast<int>(c)]);
    }
    estimates.people.push_back(std::move(person));
}

const EstimateFormat kGvhmr{{
    .program = "GVHMR",
    .looks = "GVHMR's hmr4d_results.pt",
    .recognises =
        [](const EstimateSource& source) {
            if (source.torch)
                return source.torch->root().kind() == PickleValue::Kind::dict &&
                       source.torch->root().has("smpl_params_incam");
            return source.npz && (source.npz->has("smpl_params_incam/transl") ||
                                  source.npz->has("smpl_params_incam_transl"));
        },
    .read = readGvhmr,
}};

}  // namespace

}  // namespace doppel
