#include "trainer/motion/retarget/retarget.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "trainer/motion/retarget/feet.h"
#include "trainer/motion/retarget/girth.h"
#include "trainer/motion/retarget/ground.h"
#include "trainer/motion/retarget/hands.h"

namespace doppel {

namespace {

using namespace joint;

const glm::dvec3 kAcross(1, 0, 1);
constexpr double kSamePlace = 1e-3, kSameRadius = 2e-3;  // metres

double rateOf(const Motion& motion) { return motion.fps > 0 ? motion.fps : 30; }

bool alike(const Capsule& one, const Capsule& other) {
    return std::abs(one.fromRadius - other.fromRadius) < kSameRadius &&
           std::abs(one.toRadius - other.toRadius) < kSameRadius &&
           std::abs(glm::distance(one.from, one.to) - glm::distance(other.from, other.to)) <
               2 * kSameRadius;
}

// Nothing that retargeting looks at tells them apart.
bool alike(const Proportions& one, const Proportions& other) {
    for (size_t j = 0; j < joint::kCount; ++j)
        if (glm::distance(one.rest[j], other.rest[j]) > kSamePlace) return false;
    if (one.trunk.size() != other.trunk.size()) return false;
    for (size_t i = 0; i < one.trunk.size(); ++i)
        if (!alike(one.trunk[i], other.trunk[i])) return false;
    for (size_t side : {0, 1})
        if (!alike(one.thighs[side], other.thighs[side]) ||
            !alike(one.shins[side], other.shins[side]) ||
            !alike(one.forearms[side], other.forearms[side]))
            return false;
    return true;
}

// Of the frames that two lists of contacts have, those in which any of the four flags differs.
double shareOfOthers(std::span<const FootContacts> one, std::span<const FootContacts> other) {
    double frames = 0;
    for (size_t f = 0; f < one.size(); ++f) frames += one[f] != other[f];
    return one.empty() ? 0 : frames / static_cast<double>(one.size());
}

// SMPL's own mesh, whatever its file is called, says whose coefficients its are.
bool isSmpl(const BodyModel& body) {
    return body.modelVertices == 6890 && body.modelFaces == 13776;
}

// Coefficients that mean something else to the avatar's body count for nothing, and `remark` says
// so.
Betas betasFor(const BodyModel& body, const Motion& motion, std::string& remark) {
    const bool meant =
        motion.shape == ShapeSpace::Body || (motion.shape == ShapeSpace::Smpl && isSmpl(body));
    if (meant || motion.betas == Betas{}) return motion.betas;
    remark = fmt::format(
        "its shape coefficients are {}'s, which mean something else to the avatar's body, and are "
        "left out",
        motion.shape == ShapeSpace::Smpl ? "SMPL" : "SMPL-X");
    return {};
}

std::string joined(const std::string& one, const std::string& other) {
    return one.empty() || other.empty() ? one + other : one + "; " + other;
}

}  // namespace

Reach reachNamed(std::string_view word) {
    if (word == "proportion") return Reach::Proportion;
    if (word == "space") return Reach::Space;
    throwInput("--reach: expected proportion or space, found \"{}\"", word);
}

RetargetFigures figuresOf(const Proportions& source, std::span<const JointPose> sourcePoses,
                          const Proportions& body, std::span<const JointPose> poses,
                          std::span<const FootContacts> contacts, double fps) {
    const size_t frames = poses.size();
    CHECK(sourcePoses.size() == frames && contacts.size() == frames, "the same frames");
    const auto places = contactPlaces(poses, body);
    RetargetFigures figures;
    double slides = 0, heights = 0, accelerations = 0, touches = 0;
    std::vector<PlacedJoints> joints;
    for (const JointPose& pose : poses) joints.push_back(placed(body, pose));
    for (size_t f = 0; f < frames; ++f) {
        for (size_t k = 0; k < 4; ++k) {
            if (!contacts[f][k]) continue;
            figures.height += std::abs(places[f][k].y);
            ++heights;
            if (f == 0 || !contacts[f - 1][k]) continue;
            figures.slide += glm::length(kAcross * (places[f][k] - places[f - 1][k]));
            ++slides;
        }
        const double low =
            std::min(lowestOfSole(body, joints[f], 0), lowestOfSole(body, joints[f], 1));
        figures.sunk += std::max(0., -low);
        figures.deepest = std::max(figures.deepest, -low);
        figures.overlap += excessDepth(source, sourcePoses[f], body, poses[f]);
        if (const double off = touchError(source, sourcePoses[f], body, poses[f]); off >= 0) {
            figures.touch += off;
            ++touches;
        }
        if (f == 0 || f + 1 == frames) continue;
        for (size_t j = 0; j < joint::kCount; ++j) {
            const double acceleration =
                glm::length(joints[f - 1].place[j] - 2. * joints[f].place[j] +
                            joints[f + 1].place[j]) *
                fps * fps;
            figures.acceleration += acceleration;
            figures.sharpest = std::max(figures.sharpest, acceleration);
            ++accelerations;
        }
    }
    const auto mean = [](double sum, double count, double scale) {
        return count > 0 ? scale * sum / count : 0.;
    };
    figures.slide = mean(figures.slide, slides, 1000);
    figures.height = mean(figures.height, heights, 1000);
    figures.sunk = mean(figures.sunk, double(frames), 1000);
    figures.deepest *= 1000;
    figures.overlap = mean(figures.overlap, double(frames), 1000);
    figures.touch = mean(figures.touch, touches, 1000);
    figures.wrongContacts = 100 * shareOfOthers(contacts, findContacts(poses, body, fps));
    figures.acceleration = mean(figures.acceleration, accelerations, 1);
    return figures;
}

Retargeted retarget(const Motion& motion, const Proportions& source, const Proportions& target,
                    const RetargetOptions& options) {
    Retargeted result;
    result.motion = motion;
    const std::optional<GroundFrame> ground = groundOf(motion, source);
    if (!ground) {
        if (options.contacts)
            throwInput(
                "--contacts: expected a motion whose feet stand on a ground, found none in {}",
                motion.source.string());
        result.summary = "the feet have no ground in it, so the motion stays as it is";
        return result;
    }
    const double fps = rateOf(motion);
    const std::vector<JointPose> theirs = onGround(motion, source, *ground);
    const std::vector<JointPose> asItIs = onGround(motion, target, *ground);
    result.contacts = options.contacts ? *options.contacts : findContacts(theirs, source, fps);
    CHECK(result.contacts.size() == motion.size(), "contacts for each frame");
    result.rootScale = target.legLength() / source.legLength();

    std::vector<JointPose> poses = asItIs;
    const glm::dvec3 from = theirs[0].pelvis * kAcross;
    for (size_t f = 0; f < poses.size(); ++f)
        poses[f].pelvis = from + result.rootScale * (theirs[f].pelvis - from);
    clearLegs(source, theirs, target, poses, fps);
    standOnGround(source, theirs, result.contacts, target, poses);
    result.stays =
        keepFeet(source, theirs, result.contacts, options.contacts.has_value(), target, poses, fps);
    if (options.reach == Reach::Space)
        reachInSpace(source, theirs, options.size, target, poses);
    else
        touchAsTheSource(source, theirs, target, poses, fps);
    clearArms(source, theirs, target, poses, fps);
    // Arms that had to leave a thicker body took hands apart that met.
    if (options.reach == Reach::Proportion) touchAsTheSource(source, theirs, target, poses, fps);

    result.source = figuresOf(source, theirs, source, theirs, result.contacts, fps);
    result.before = figuresOf(source, theirs, target, asItIs, result.contacts, fps);
    result.after = figuresOf(source, theirs, target, poses, result.contacts, fps);
    fromGround(poses, target, *ground, result.motion);
    result.changed = true;
    result.summary = fmt::format(
        "root scaled by {:.2f}, feet kept on the ground in {} contacts of heels and toes",
        result.rootScale, result.stays);
    return result;
}

Retargeted retargetTo(const RetargetTarget& target, Motion motion,
                      const RetargetSettings& settings) {
    Retargeted result;
    RetargetOptions options;
    options.reach = reachNamed(settings.reach);
    if (!settings.contacts.empty())
        options.contacts = readContacts(settings.contacts, motion.size());
    std::string remark;
    const auto asItIs = [&] {
        result.motion = std::move(motion);
        result.summary = remark;
        return result;
    };
    if (!settings.on) return asItIs();
    const bool asked = options.contacts || options.reach == Reach::Space;
    const Betas betas = betasFor(target.body, motion, remark);
    const bool shaped = betas != Betas{};
    if (!asked && shaped && betas == target.betas) return asItIs();
    if (!asked && target.learntFromIt) return asItIs();
    BodyModel model = target.body;
    if (betas != target.betas || !shaped) model.offsets.clear();
    Proportions theirs = proportionsOf(model, betas);
    const Proportions ours = proportionsOf(target.body, target.betas);
    if (motion.skeleton) {
        theirs = withJoints(std::move(theirs), motion.skeleton->rest);
        options.size = motion.skeleton->size;
    }
    if (!asked && alike(theirs, ours)) return asItIs();
    result = retarget(motion, theirs, ours, options);
    result.summary = joined(result.summary, remark);
    return result;
}

}  // namespace doppel
