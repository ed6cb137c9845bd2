#include "trainer/eval/clip_truth.h"

#include <Eigen/Dense>
#include <algorithm>
#include <glm/geometric.hpp>
#include <map>

#include "engine/error.h"
#include "engine/files/npz.h"
#include "engine/io/image.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/output_folder.h"
#include "trainer/eval/metrics.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr std::array<size_t, 12> kLimbs{
    joint::kLeftShoulder, joint::kRightShoulder, joint::kLeftElbow, joint::kRightElbow,
    joint::kLeftWrist,    joint::kRightWrist,    joint::kLeftHip,   joint::kRightHip,
    joint::kLeftKnee,     joint::kRightKnee,     joint::kLeftAnkle, joint::kRightAnkle};

Eigen::Vector3d eigen(const glm::dvec3& v) { return {v.x, v.y, v.z}; }

double mean(const std::vector<double>& values) {
    double sum = 0;
    for (double v : values) sum += v;
    return sum / double(values.size());
}

}  // namespace

JointPlaces jointPlaces(const BodyModel& body, const Betas& betas, const Theta& theta,
                        const Trans& trans) {
    const std::vector<double> shape(betas.begin(), betas.end());
    const std::vector<double> flat = restJoints(body, shape);
    const auto rest = [&](size_t j) {
        return glm::dvec3(flat[3 * j], flat[3 * j + 1], flat[3 * j + 2]);
    };
    JointPlaces places;
    std::array<glm::dquat, joint::kCount> turned;
    for (size_t j = 0; j < joint::kCount; ++j) {
        turned[j] = jointRotation(theta, j);
        if (body.parents[j] < 0) {
            places[j] = rest(j) + glm::dvec3(trans[0], trans[1], trans[2]);
            continue;
        }
        const auto parent = size_t(body.parents[j]);
        turned[j] = turned[parent] * turned[j];
        places[j] = places[parent] + turned[parent] * (rest(j) - rest(parent));
    }
    return places;
}

ClipTruth readClipTruth(const fs::path& folder, const BodyModel& body) {
    const fs::path masks = folder / "masks", file = folder / "poses.npz";
    std::error_code error;
    if (!fs::is_directory(masks, error) || !fs::is_regular_file(file, error)) {
        throwInput(
            "{}: expected a truth, masks/ and poses.npz (docs/formats.md, \"What is known of a "
            "clip\"), found neither or one",
            folder.string());
    }
    ClipTruth truth;
    for (const auto& entry : fs::directory_iterator(masks))
        if (entry.path().extension() == ".png") truth.masks.push_back(entry.path());
    std::ranges::sort(truth.masks, [](const fs::path& a, const fs::path& b) {
        return naturallyBefore(a.stem().string(), b.stem().string());
    });
    for (const fs::path& mask : truth.masks) truth.names.push_back(mask.stem().string());
    const Poses poses = readPoses(file, true);
    if (poses.theta.size() != truth.names.size()) {
        throwInput("{}: expected poses of {} frames, as many as masks/ has, found {}",
                   file.string(), truth.names.size(), poses.theta.size());
    }
    const Npz arrays = readNpz(file);
    if (!arrays.has("joints")) {
        for (size_t f = 0; f < poses.theta.size(); ++f)
            truth.joints.push_back(jointPlaces(body, poses.betas, poses.theta[f], poses.trans[f]));
        return truth;
    }
    const std::vector<float> joints =
        arrays.at("joints").requireShape({int64_t(poses.theta.size()), kJointCount, 3}).toF32();
    requireFinite(joints, file.string() + ": joints", 3 * joint::kCount, kMostMetres);
    truth.joints.resize(poses.theta.size());
    for (size_t f = 0; f < truth.joints.size(); ++f)
        for (size_t j = 0; j < joint::kCount; ++j) {
            const float* v = &joints[3 * (f * joint::kCount + j)];
            truth.joints[f][j] = {v[0], v[1], v[2]};
        }
    return truth;
}

std::vector<FrameError> compareWithTruth(const Capture& capture, const ClipTruth& truth,
                                         const BodyModel& body) {
    std::map<std::string, size_t> numbers;
    for (size_t f = 0; f < truth.names.size(); ++f) numbers[truth.names[f]] = f;
    std::vector<FrameError> errors;
    for (size_t f = 0; f < capture.size(); ++f) {
        const Frame& frame = capture.frames[f];
        const auto at = numbers.find(frame.name);
        if (at == numbers.end()) continue;
        const JointPlaces got =
            jointPlaces(body, capture.betas, capture.theta[f], capture.trans[f]);
        const JointPlaces& want = truth.joints[at->second];
        FrameError e{.name = frame.name};
        Eigen::Matrix<double, 3, Eigen::Dynamic> from(3, kLimbs.size()), to(3, kLimbs.size());
        std::vector<double> apart;
        for (size_t k = 0; k < kLimbs.size(); ++k) {
            const size_t j = kLimbs[k];
            const glm::dvec3 a = got[j] - got[0], b = want[j] - want[0];
            apart.push_back(1000 * glm::length(a - b));
            from.col(Eigen::Index(k)) = eigen(a);
            to.col(Eigen::Index(k)) = eigen(b);
        }
        e.joints = mean(apart);
        const Eigen::Matrix4d best = Eigen::umeyama(from, to, true);
        const Eigen::Vector3d shift = best.topRightCorner<3, 1>();
        const Eigen::Matrix3Xd moved = (best.topLeftCorner<3, 3>() * from).colwise() + shift;
        e.aligned = 1000 * (moved - to).colwise().norm().mean();
        e.pelvis = 1000 * glm::length(got[0] - want[0]);
        if (frame.mask) {
            const Image a = readMask(*frame.mask), b = readMask(truth.masks[at->second]);
            if (a.width != b.width || a.height != b.height) {
                throwInput("{}: expected {}×{} pixels, the size of {}, found {}×{}",
                           frame.mask->string(), b.width, b.height,
                           truth.masks[at->second].string(), a.width, a.height);
            }
            e.iou = intersectionOverUnion(a.data, b.data);
        }
        errors.push_back(std::move(e));
    }
    if (errors.empty()) {
        throwInput("{}: expected frames with names of the truth's ({} to {}), found none",
                   capture.folder.string(), truth.names.empty() ? "none" : truth.names.front(),
                   truth.names.empty() ? "none" : truth.names.back());
    }
    return errors;
}

}  // namespace doppel
