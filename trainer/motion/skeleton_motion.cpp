#include "trainer/motion/skeleton_motion.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <initializer_list>
#include <optional>
#include <utility>

#include "engine/error.h"
#include "engine/files/printable.h"
#include "nn/body/joint.h"

namespace doppel {

namespace {

// ---- names --------------------------------------------------------------------------------------

struct Label {
    char side = 0;     // 'l', 'r', or 0 in the middle
    std::string base;  // lower case, without side, prefixes and numbers: "upleg"
};

// "mixamorig:LeftUpLeg", "LeftUpLeg", "thigh_l" and "Bip01 L Thigh" by their parts.
Label labelOf(std::string_view name) {
    const size_t colon = name.rfind(':');
    if (colon != std::string_view::npos && colon + 1 < name.size()) name.remove_prefix(colon + 1);
    std::vector<std::string> words;
    bool fresh = true;
    for (size_t i = 0; i < name.size(); ++i) {
        const auto c = static_cast<unsigned char>(name[i]);
        if (!std::isalnum(c)) {
            fresh = true;
            continue;
        }
        if (std::isupper(c) && i > 0) {
            const bool afterSmall = std::islower(static_cast<unsigned char>(name[i - 1])) != 0;
            const bool beforeSmall =
                i + 1 < name.size() && std::islower(static_cast<unsigned char>(name[i + 1])) != 0;
            if (afterSmall || beforeSmall) fresh = true;
        }
        if (fresh) words.emplace_back();
        fresh = false;
        words.back() += static_cast<char>(std::tolower(c));
    }
    std::erase_if(words, [](const std::string& word) {
        return word.starts_with("mixamorig") || word.starts_with("bip0") || word == "bip" ||
               word == "def" || word == "j" || word == "jnt" || word == "bone" ||
               word == "character1";
    });
    Label label;
    const auto sideOf = [](const std::string& word) -> char {
        if (word == "l" || word == "left") return 'l';
        if (word == "r" || word == "right") return 'r';
        return 0;
    };
    if (!words.empty() && sideOf(words.front()) != 0) {
        label.side = sideOf(words.front());
        words.erase(words.begin());
    } else if (!words.empty() && sideOf(words.back()) != 0) {
        label.side = sideOf(words.back());
        words.pop_back();
    }
    for (const std::string& word : words) label.base += word;
    // All in one case: "LEFTUPLEG", "leftupleg".
    if (label.side == 0) {
        for (const std::string_view side : {"left", "right"}) {
            if (label.base.size() <= side.size() || !label.base.starts_with(side)) continue;
            label.side = side[0];
            label.base.erase(0, side.size());
            break;
        }
    }
    while (!label.base.empty() && std::isdigit(static_cast<unsigned char>(label.base.back())))
        label.base.pop_back();
    return label;
}

// ---- joints -------------------------------------------------------------------------------------

constexpr int kNone = -1;

struct Mapping {
    std::array<int, joint::kCount> of;  // the source's joint for SMPL's; kNone
    std::vector<int> spine, neck;       // from the pelvis upwards
};

bool hangsOn(const SkeletonMotion& source, int joint, int root) {
    while (joint > root) joint = source.joints[static_cast<size_t>(joint)].parent;
    return joint == root;
}

int commonAncestor(const SkeletonMotion& source, int a, int b) {
    while (a != b) (a > b ? a : b) = source.joints[static_cast<size_t>(std::max(a, b))].parent;
    return a;
}

Mapping findJoints(const SkeletonMotion& source) {
    std::vector<Label> labels;
    for (const SkeletonMotion::Joint& joint : source.joints)
        labels.push_back(joint.name.empty() ? Label{} : labelOf(joint.name));
    const auto find = [&](char side, std::initializer_list<std::string_view> bases) {
        for (const std::string_view base : bases)
            for (size_t j = 0; j < labels.size(); ++j)
                if (labels[j].side == side && labels[j].base == base) return static_cast<int>(j);
        return kNone;
    };
    Mapping map;
    map.of.fill(kNone);
    auto& of = map.of;
    for (const char side : {'l', 'r'}) {
        const size_t right = side == 'r' ? 1 : 0;  // each right joint follows its left one
        int& hip = of[joint::kLeftHip + right];
        int& knee = of[joint::kLeftKnee + right];
        hip = find(side, {"upleg", "thigh", "upperleg", "thighbend", "femur", "hip"});
        knee = find(side, {"knee", "leg", "lowleg", "lowerleg", "shin", "calf", "tibia"});
        // A leg is the thigh of those who have a shin below it and nothing else above.
        const int shin = find(side, {"shin", "calf"});
        if (hip == kNone && shin != kNone && knee != shin) hip = std::exchange(knee, shin);
        // Where there is an ankle a foot is what hangs on it, and a hand on a wrist.
        const int ankle = find(side, {"ankle"}), wrist = find(side, {"wrist"});
        of[joint::kLeftAnkle + right] = ankle != kNone ? ankle : find(side, {"foot"});
        of[joint::kLeftFoot + right] = find(side, {"toebase", "toe", "toes", "ball"});
        if (ankle != kNone && of[joint::kLeftFoot + right] == kNone)
            of[joint::kLeftFoot + right] = find(side, {"foot"});
        of[joint::kLeftWrist + right] = wrist != kNone ? wrist : find(side, {"hand"});
        if (wrist != kNone) of[joint::kLeftHand + right] = find(side, {"hand"});
        // A shoulder is the collar bone of those who call the upper arm an arm.
        const int arm = find(side, {"arm", "upperarm", "uparm", "shldr", "shldrbend", "humerus"});
        const int shoulder = find(side, {"shoulder"}), collar = find(side, {"collar", "clavicle"});
        of[joint::kLeftShoulder + right] = arm != kNone ? arm : shoulder;
        of[joint::kLeftCollar + right] = collar != kNone ? collar : arm != kNone ? shoulder : kNone;
        of[joint::kLeftElbow + right] =
            find(side, {"elbow", "forearm", "forearmbend", "lowerarm", "lowarm"});
    }

    // What is there has to hang together.
    constexpr std::array<std::pair<joint::Number, joint::Number>, 12> kLimbs = {{
        {joint::kLeftKnee, joint::kLeftHip},
        {joint::kRightKnee, joint::kRightHip},
        {joint::kLeftAnkle, joint::kLeftKnee},
        {joint::kRightAnkle, joint::kRightKnee},
        {joint::kLeftFoot, joint::kLeftAnkle},
        {joint::kRightFoot, joint::kRightAnkle},
        {joint::kLeftElbow, joint::kLeftShoulder},
        {joint::kRightElbow, joint::kRightShoulder},
        {joint::kLeftWrist, joint::kLeftElbow},
        {joint::kRightWrist, joint::kRightElbow},
        {joint::kLeftHand, joint::kLeftWrist},
        {joint::kRightHand, joint::kRightWrist},
    }};
    std::string missing;
    for (const size_t j :
         {joint::kLeftHip, joint::kRightHip, joint::kLeftKnee, joint::kRightKnee,
          joint::kLeftShoulder, joint::kRightShoulder, joint::kLeftElbow, joint::kRightElbow})
        if (of[j] == kNone)
            missing += fmt::format("{}{}", missing.empty() ? "" : ", ", jointName(j));
    if (!missing.empty()) {
        std::string names;
        for (size_t j = 0, count = 0; j < source.joints.size() && count < 12; ++j) {
            if (source.joints[j].name.empty()) continue;
            names +=
                fmt::format("{}{}", names.empty() ? "" : ", ", printable(source.joints[j].name));
            ++count;
        }
        throwInput(
            "{}: expected a person's joints, with names such as LeftUpLeg, LeftLeg, LeftArm, "
            "LeftForeArm, found none for {} among {}…",
            source.file, missing, names);
    }
    for (const auto& [end, root] : kLimbs) {
        if (of[end] == kNone ||
            (of[root] != kNone && of[end] != of[root] && hangsOn(source, of[end], of[root])))
            continue;
        // Toes and hands can be done without.
        if (end == joint::kLeftFoot || end == joint::kRightFoot || end == joint::kLeftHand ||
            end == joint::kRightHand || of[root] == kNone) {
            of[end] = kNone;
            continue;
        }
        throwInput("{}: expected {} (for {}) below {} (for {}), found it elsewhere", source.file,
                   printable(source.joints[static_cast<size_t>(of[end])].name), jointName(end),
                   printable(source.joints[static_cast<size_t>(of[root])].name), jointName(root));
    }
    for (const size_t right : {0u, 1u}) {
        int& collar = of[joint::kLeftCollar + right];
        const int shoulder = of[joint::kLeftShoulder + right];
        if (collar != kNone && (collar == shoulder || !hangsOn(source, shoulder, collar)))
            collar = kNone;
    }

    const int legs = commonAncestor(source, of[joint::kLeftHip], of[joint::kRightHip]);
    const int arms = commonAncestor(source, of[joint::kLeftShoulder], of[joint::kRightShoulder]);
    int pelvis = find(0, {"hips", "pelvis", "hip"});
    if (pelvis == kNone || !hangsOn(source, legs, pelvis) || !hangsOn(source, arms, pelvis))
        pelvis = legs;
    if (!hangsOn(source, arms, pelvis)) pelvis = commonAncestor(source, legs, arms);
    of[joint::kPelvis] = pelvis;

    // The spine is what lies between the pelvis and the neck, whatever it is called.
    int head = find(0, {"head"});
    int top = head != kNone ? head : find(0, {"neck"});
    if (top == kNone || top == pelvis || !hangsOn(source, top, pelvis)) head = kNone, top = arms;
    std::vector<int> path;  // from top down to, but not, the pelvis
    for (int j = top; j > pelvis; j = source.joints[static_cast<size_t>(j)].parent)
        path.push_back(j);
    std::reverse(path.begin(), path.end());
    bool neck = false;
    for (const int j : path) {
        if (j == head) break;
        neck = neck || labels[static_cast<size_t>(j)].base == "neck";
        (neck ? map.neck : map.spine).push_back(j);
    }
    of[joint::kHead] = head;
    return map;
}

// ---- retargeting --------------------------------------------------------------------------------

constexpr std::array<int, joint::kCount> kParents = {-1, 0, 0, 0,  1,  2,  3,  4,  5,  6,  7,  8,
                                                     9,  9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21};

// The default body's joints, metres: where SMPL's are, for the mean shape, within a few
// centimetres.
constexpr std::array<std::array<double, 3>, joint::kCount> kRest = {{
    {0, -.223, .028},          {.07171, -.28332, .03953},  {-.07171, -.28332, .03953},
    {0, -.07696, .00469},      {.09382, -.62884, .03585},  {-.09382, -.62884, .03585},
    {0, .04128, .00332},       {.08975, -1.03452, -.009},  {-.08975, -1.03452, -.009},
    {0, .0902, -.00018},       {.11738, -1.08134, .12098}, {-.11738, -1.08134, .12098},
    {0, .31676, -.01005},      {.05942, .21393, .02031},   {-.05942, .21393, .02031},
    {0, .37451, .03834},       {.164, .24956, .00997},     {-.164, .24956, .00997},
    {.40658, .24955, .00997},  {-.40658, .24955, .00997},  {.64513, .24955, .00997},
    {-.64513, .24955, .00997}, {.74456, .24954, .00997},   {-.74456, .24954, .00997},
}};

glm::dvec3 restOf(size_t joint) { return {kRest[joint][0], kRest[joint][1], kRest[joint][2]}; }

class Retarget {
public:
    explicit Retarget(const SkeletonMotion& source)
        : source_(source), map_(findJoints(source)), rest_(source.placed(-1)) {
        findScale();
        // Some programs' offsets lie along each bone's own axis: what they make is no person. Then
        // the frame in which the body is most stretched serves as the rest pose.
        const bool asIs = stands();
        if (!asIs) takeStretchedFrame();
        findFrame(asIs);
        for (glm::dquat& align : align_) align = frame_;
        for (const size_t right : {0u, 1u}) {
            alignLimb(
                {joint::kLeftHip + right, joint::kLeftKnee + right, joint::kLeftAnkle + right});
            alignLimb({joint::kLeftShoulder + right, joint::kLeftElbow + right,
                       joint::kLeftWrist + right, joint::kLeftHand + right});
        }
    }

    // "arms down as the rest pose, 0.01 metres to the unit".
    std::string note() const {
        const auto along = [&](size_t shoulder, size_t elbow) {
            const glm::dvec3 arm = restPlace(elbow) - restPlace(shoulder);
            const glm::dvec3 up = frame_ * glm::dvec3(0, 1, 0);
            return glm::dot(arm, up) / std::max(glm::length(arm), 1e-12);
        };
        const double slope = (along(joint::kLeftShoulder, joint::kLeftElbow) +
                              along(joint::kRightShoulder, joint::kRightElbow)) /
                             2;
        const char* arms = slope < -.85 ? "arms down" : slope < -.3 ? "an A-pose" : "a T-pose";
        return fmt::format("{} as the rest pose{}, {:.4g} metres to the unit", arms,
                           restFrame_ < 0
                               ? ""
                               : fmt::format(" (frame {}, for the skeleton's is none)", restFrame_),
                           scale_);
    }

    // Legs and arms as long as the rest pose has them, hips and shoulders as far apart and as far
    // above each other; trunk and neck go along, hands and feet are the default body's.
    SourceSkeleton skeleton() const {
        SourceSkeleton found;
        auto& rest = found.rest;
        const auto middle = [](size_t left) { return .5 * (restOf(left) + restOf(left + 1)); };
        const glm::dvec3 hips = middle(joint::kLeftHip);
        const double apart = boneLength(joint::kRightHip, joint::kLeftHip),
                     broad = boneLength(joint::kRightShoulder, joint::kLeftShoulder);
        const double tall = middle(joint::kLeftShoulder).y - hips.y;
        const double theirs =
            glm::dot(restMiddle(joint::kLeftShoulder) - restMiddle(joint::kLeftHip),
                     frame_ * glm::dvec3(0, 1, 0));
        const double higher = believed(scale_ * theirs, tall) / tall;
        const double wider =
            broad / glm::distance(restOf(joint::kRightShoulder), restOf(joint::kLeftShoulder));
        for (size_t j = 0; j < joint::kCount; ++j) {
            rest[j] = restOf(j);
            if (rest[j].y <= hips.y) continue;
            rest[j].x *= wider;
            rest[j].y = hips.y + higher * (rest[j].y - hips.y);
        }
        rest[joint::kHead] = rest[joint::kNeck] + restOf(joint::kHead) - restOf(joint::kNeck);
        for (const size_t right : {0u, 1u}) {
            rest[joint::kLeftHip + right].x = (right == 0 ? .5 : -.5) * apart;
            stretchLimb({joint::kLeftHip + right, joint::kLeftKnee + right,
                         joint::kLeftAnkle + right, joint::kLeftFoot + right},
                        rest);
            stretchLimb({joint::kLeftShoulder + right, joint::kLeftElbow + right,
                         joint::kLeftWrist + right, joint::kLeftHand + right},
                        rest);
        }
        found.size = sizeOfMotion();
        return found;
    }

    void pose(int64_t frame, Theta& theta, Trans& trans) const {
        const SkeletonMotion::Placement placed = source_.placed(frame);
        std::array<glm::dquat, joint::kCount> global;
        for (size_t j = 0; j < joint::kCount; ++j) {
            if (j == joint::kSpine1 || j == joint::kSpine2 || j == joint::kSpine3) {
                const double share = j == joint::kSpine1 ? 1. : j == joint::kSpine2 ? 2. : 3.;
                global[j] = spineAt(placed, share / 3) * frame_;
            } else if (j == joint::kNeck && !map_.neck.empty()) {
                global[j] = middleOf(placed, map_.neck) * frame_;
            } else if (map_.of[j] != kNone) {
                global[j] = turned(placed, map_.of[j]) * align_[j];
            } else {
                global[j] = global[static_cast<size_t>(kParents[j])];
            }
            const glm::dquat local =
                kParents[j] < 0
                    ? global[j]
                    : glm::conjugate(global[static_cast<size_t>(kParents[j])]) * global[j];
            setJointRotation(theta, j, glm::normalize(local));
        }
        // The middle of the hip joints is where the source has it: pelvises differ more.
        const auto middle = [](const glm::dvec3& a, const glm::dvec3& b) { return .5 * (a + b); };
        const glm::dvec3 hips =
            scale_ * middle(placed.position[static_cast<size_t>(map_.of[joint::kLeftHip])],
                            placed.position[static_cast<size_t>(map_.of[joint::kRightHip])]);
        const glm::dvec3 ours =
            middle(restOf(joint::kLeftHip), restOf(joint::kRightHip)) - restOf(joint::kPelvis);
        const glm::dvec3 place = hips - global[0] * ours - restOf(joint::kPelvis);
        for (int c = 0; c < 3; ++c) trans[static_cast<size_t>(c)] = static_cast<float>(place[c]);
    }

private:
    glm::dvec3 restPlace(size_t joint) const {
        return rest_.position[static_cast<size_t>(map_.of[joint])];
    }
    glm::dvec3 restMiddle(size_t left) const {
        return .5 * (restPlace(left) + restPlace(left + 1));
    }

    // A length that no person has, or that is no number, is a mistake of the file, or of a bone
    // that means something else.
    static double believed(double theirs, double ours) {
        const double least = .4 * ours, most = 2.5 * ours;
        return theirs > least ? std::min(theirs, most) : least;
    }

    // From joint to joint, metres of the motion, the mean of left and right: bodies are even, and
    // what files have is not. Where the source has no such joints, the default body's.
    double boneLength(size_t from, size_t to) const {
        double theirs = 0, count = 0;
        for (const auto& [a, b] :
             {std::pair(from, to), std::pair(oppositeJoint(from), oppositeJoint(to))}) {
            if (map_.of[a] == kNone || map_.of[b] == kNone) continue;
            theirs += scale_ * glm::distance(restPlace(a), restPlace(b));
            ++count;
        }
        const double ours = glm::distance(restOf(from), restOf(to));
        return count > 0 ? believed(theirs / count, ours) : ours;
    }

    // The default body's bones, the first two as long as the source's.
    void stretchLimb(const std::array<size_t, 4>& joints,
                     std::array<glm::dvec3, joint::kCount>& rest) const {
        for (size_t i = 0; i + 1 < joints.size(); ++i) {
            glm::dvec3 bone = restOf(joints[i + 1]) - restOf(joints[i]);
            if (i < 2) bone *= boneLength(joints[i], joints[i + 1]) / glm::length(bone);
            rest[joints[i + 1]] = rest[joints[i]] + bone;
        }
    }

    // Formats that do not say what their unit is have one of those in which a leg is as long as
    // people's. 1 where nothing fits.
    double sizeOfMotion() const {
        constexpr double kShortest = .55, kLongest = 1.1;  // of a leg, metres
        constexpr double kCentimetres = .01, kInches = .0254, kOfCmu = .0564444;
        const double leg = (boneLength(joint::kLeftHip, joint::kLeftKnee) +
                            boneLength(joint::kLeftKnee, joint::kLeftAnkle)) /
                           scale_;
        const auto fits = [&](double metres) {
            return metres * leg > kShortest && metres * leg < kLongest;
        };
        for (const double metres : {source_.metres, 1., kCentimetres, kInches, kOfCmu}) {
            if (metres > 0 && fits(metres)) return metres / scale_;
            if (source_.metres > 0) break;
        }
        return 1;
    }

    // How a joint of the source has turned since the rest pose, in the world.
    glm::dquat turned(const SkeletonMotion::Placement& placed, int joint) const {
        const auto j = static_cast<size_t>(joint);
        return placed.rotation[j] * glm::conjugate(rest_.rotation[j]);
    }

    void findScale() {
        double ours = 0, theirs = 0;
        for (const size_t right : {0u, 1u}) {
            const auto add = [&](size_t from, size_t to) {
                if (map_.of[from + right] == kNone || map_.of[to + right] == kNone) return;
                ours += glm::length(restOf(to + right) - restOf(from + right));
                theirs += glm::length(restPlace(to + right) - restPlace(from + right));
            };
            add(joint::kLeftHip, joint::kLeftKnee);
            add(joint::kLeftKnee, joint::kLeftAnkle);
        }
        if (!(theirs > 1e-9))
            throwInput("{}: {}: expected legs of some length, found none", source_.file,
                       source_.rest);
        scale_ = ours / theirs;
    }

    // From right to left, and from knees to shoulders.
    glm::dvec3 sideways() const {
        return restPlace(joint::kLeftHip) - restPlace(joint::kRightHip) +
               restPlace(joint::kLeftShoulder) - restPlace(joint::kRightShoulder);
    }
    glm::dvec3 upwards() const {
        return restMiddle(joint::kLeftShoulder) - restMiddle(joint::kLeftKnee);
    }

    bool stands() const {
        const glm::dvec3 side = sideways(), up = upwards();
        const double tall = glm::length(up), wide = glm::length(side);
        // A person is .9 m from knees to shoulders, hips and shoulders together half a metre wide,
        // and the knees are below the hips as the hips are below the shoulders.
        return scale_ * tall > .5 && scale_ * wide > .1 &&
               std::abs(glm::dot(up, side)) < .5 * tall * wide &&
               glm::dot(up, restMiddle(joint::kLeftHip) - restMiddle(joint::kLeftKnee)) >
                   .7 * tall * .34 / scale_;
    }

    void takeStretchedFrame() {
        constexpr size_t kLookedAt = 500;
        SkeletonMotion::Placement best;
        double longest = 0;
        const size_t step = (source_.frames + kLookedAt - 1) / kLookedAt;
        for (size_t f = 0; f < source_.frames; f += step) {
            rest_ = source_.placed(static_cast<int64_t>(f));
            if (!stands()) continue;
            double length = 0;
            const auto add = [&](size_t from, size_t to) {
                if (map_.of[to] != kNone) length += glm::length(restPlace(to) - restPlace(from));
            };
            for (const size_t right : {0u, 1u}) {
                add(joint::kLeftShoulder + right, joint::kLeftKnee + right);
                add(joint::kLeftShoulder + right, joint::kLeftAnkle + right);
                add(joint::kLeftShoulder + right, joint::kLeftWrist + right);
            }
            if (length <= longest * (1 + 1e-9)) continue;
            longest = length;
            restFrame_ = static_cast<int64_t>(f);
            best = rest_;
        }
        if (longest == 0)
            throwInput(
                "{}: {}: expected a rest pose, or any frame, in which a person stands upright, "
                "found none",
                source_.file, source_.rest);
        rest_ = std::move(best);
    }

    // Which way the rest pose stands and looks: SMPL's axes in the source's world.
    void findFrame(bool looksAlongAnAxis) {
        // People stand along an axis of the world, and rest poses look along one too; what bones
        // lean beside it is anatomy.
        const auto snapped = [](const glm::dvec3& v) {
            int largest = 0;
            for (int c = 1; c < 3; ++c)
                if (std::abs(v[c]) > std::abs(v[largest])) largest = c;
            glm::dvec3 axis(0);
            axis[largest] = v[largest] < 0 ? -1 : 1;
            return std::abs(v[largest]) > .9 ? axis : v;
        };
        const glm::dvec3 up = snapped(glm::normalize(upwards()));
        glm::dvec3 side = sideways();
        side = glm::normalize(side - glm::dot(side, up) * up);
        if (looksAlongAnAxis) {
            side = snapped(side);
            side = glm::normalize(side - glm::dot(side, up) * up);
        }
        frame_ = glm::normalize(glm::quat_cast(glm::dmat3(side, up, glm::cross(side, up))));
    }

    // From joint to joint along a limb, which turns its bones as little as possible from those of
    // the T-pose to those of the source's rest pose.
    void alignLimb(const std::vector<size_t>& joints) {
        glm::dquat align = frame_;
        for (size_t i = 0; i < joints.size(); ++i) {
            const size_t joint = joints[i];
            if (map_.of[joint] == kNone) continue;
            const bool leg = joints.size() == 3;
            // Feet stand on the ground in either rest pose.
            if (leg && i == 2) continue;
            if (i + 1 < joints.size()) {
                const auto ours = glm::normalize(restOf(joints[i + 1]) - restOf(joint));
                glm::dvec3 theirs(0);
                if (map_.of[joints[i + 1]] != kNone)
                    theirs = restPlace(joints[i + 1]) - restPlace(joint);
                else if (i > 0)
                    theirs = ending(map_.of[joint]);
                const double length = glm::length(theirs);
                const glm::dvec3 before = align * ours;
                // A thumb alone points elsewhere than the hand.
                const bool sure = map_.of[joints[i + 1]] != kNone;
                if (length > 1e-6 / scale_ && (sure || glm::dot(before, theirs) > .9 * length))
                    align = turnBetween(before, theirs / length) * align;
            }
            align_[joint] = glm::normalize(align);
        }
    }

    // From a hand to the middle of what hangs on it. Where that is only a bone's end it may be
    // anything.
    glm::dvec3 ending(int joint) const {
        glm::dvec3 sum(0);
        for (size_t j = 0; j < source_.joints.size(); ++j)
            if (source_.joints[j].parent == joint && !source_.joints[j].name.empty())
                sum += rest_.position[j] - rest_.position[static_cast<size_t>(joint)];
        return sum;
    }

    // The spine's turn from the world at a share of its way from the pelvis up.
    glm::dquat spineAt(const SkeletonMotion::Placement& placed, double share) const {
        const auto at = [&](size_t i) {
            return turned(placed, i == 0 ? map_.of[joint::kPelvis] : map_.spine[i - 1]);
        };
        const double place = share * static_cast<double>(map_.spine.size());
        const auto below =
            std::min(static_cast<size_t>(std::floor(place + 1e-9)), map_.spine.size());
        const double part = std::max(place - static_cast<double>(below), 0.);
        if (part < 1e-9 || below == map_.spine.size()) return at(below);
        return glm::slerp(at(below), at(below + 1), part);
    }

    glm::dquat middleOf(const SkeletonMotion::Placement& placed,
                        const std::vector<int>& joints) const {
        const auto at = [&](size_t i) { return turned(placed, joints[i]); };
        const size_t half = (joints.size() - 1) / 2;
        return joints.size() % 2 ? at(half) : glm::slerp(at(half), at(half + 1), .5);
    }

    const SkeletonMotion& source_;
    Mapping map_;
    SkeletonMotion::Placement rest_;
    int64_t restFrame_ = -1;  // that stands in for the rest pose
    double scale_ = 1;
    glm::dquat frame_;
    // A joint's frame is the source's times this.
    std::array<glm::dquat, joint::kCount> align_;
};

}  // namespace

Motion motionFromSkeleton(const SkeletonMotion& source) {
    const Retarget retarget(source);
    Motion motion;
    motion.source = source.file;
    motion.name = motion.source.stem().string();
    motion.note = retarget.note();
    motion.skeleton = retarget.skeleton();
    // Files round: ".0333333" is thirty a second.
    const double fps = 1 / source.frameTime, whole = std::round(fps);
    motion.fps = std::abs(fps - whole) < 5e-4 * fps ? whole : fps;
    motion.theta.resize(source.frames);
    motion.trans.resize(source.frames);
    for (size_t f = 0; f < source.frames; ++f)
        retarget.pose(static_cast<int64_t>(f), motion.theta[f], motion.trans[f]);
    // Bones without length have no direction, and huge ones lie beyond what a body can be moved.
    const auto all = [](const auto& rows) {
        return std::span(rows.data()->data(), rows.size() * rows.data()->size());
    };
    requireFinite(all(motion.theta), source.file + ": rotations", kThetaSize, kMostRadians);
    requireFinite(all(motion.trans), source.file + ": translations", 3, kMostMetres);
    return motion;
}

std::array<glm::dvec3, joint::kCount> placeJoints(const Theta& theta, const Trans& trans) {
    std::array<glm::dquat, joint::kCount> turn;
    std::array<glm::dvec3, joint::kCount> place;
    for (size_t j = 0; j < joint::kCount; ++j) {
        turn[j] = jointRotation(theta, j);
        place[j] = restOf(j) + glm::dvec3(trans[0], trans[1], trans[2]);
        if (kParents[j] < 0) continue;
        const auto parent = static_cast<size_t>(kParents[j]);
        turn[j] = turn[parent] * turn[j];
        place[j] = place[parent] + turn[parent] * (restOf(j) - restOf(parent));
    }
    return place;
}

}  // namespace doppel
