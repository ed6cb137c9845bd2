// Motion between bodies of different size and shape: feet stay where they are put, the root moves
// as far as the legs carry it, and no limb goes through the body.
//
// Root height and speed follow the ratio of the legs, as Chan, Ginosar, Zhou and Efros normalise a
// target's pose (Everybody Dance Now, ICCV 2019). Contacts of the feet are constraints that inverse
// kinematics keeps, as in Gomes, Martins, Ferreira and Nascimento's shape-aware retargeting (Do As
// I Do, WACV 2020; A Shape-Aware Retargeting Approach to Transfer Human Motion and Appearance in
// Monocular Videos, IJCV 2021); here in closed form, frame by frame, with smooth weights over time.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "nn/body/body.h"
#include "trainer/motion/motion.h"
#include "trainer/motion/retarget/contacts.h"
#include "trainer/motion/retarget/proportions.h"

namespace doppel {

// Where hands go (hands.h). Proportion: where the source's rotations take them, and what they touch
// of each other and of the body, they touch. Space: the knuckles are as high above the ground, and
// as far from the root across it, as the source's, in metres that are not scaled, for what they
// reach for is as large as it was; within the arm's length.
enum class Reach { Proportion, Space };
// "proportion", "space"; InputError naming --reach otherwise.
Reach reachNamed(std::string_view word);

// Of a motion on one body. Means over frames, or over what is named.
struct RetargetFigures {
    double slide = 0;    // mm per frame that contact points move across the ground in contact
    double height = 0;   // mm that contact points are above or below the ground in contact
    double sunk = 0;     // mm that the lowest point of the soles is below the ground
    double deepest = 0;  // mm, of all frames
    double overlap = 0;  // mm of excessDepth()
    double touch = 0;    // mm of touchError(), of the frames in which the source's hands touch
    double wrongContacts = 0;  // % of frames in which other points of the feet stand than should
    double acceleration = 0;   // m/s^2, of all joints
    double sharpest = 0;       // m/s^2, the largest acceleration of a joint in a frame
};

struct RetargetOptions {
    Reach reach = Reach::Proportion;
    std::optional<std::vector<FootContacts>> contacts;  // else they are found
    double size = 1;  // of the world's metres in one of the motion's, for Reach::Space
};

struct Retargeted {
    Motion motion;                                         // of the target's body
    bool changed = false;                                  // false: `motion` is what was given
    size_t found = 0;                                      // frames in poses that training found
    double rootScale = 1;                                  // target's legs over the source's
    size_t stays = 0;                                      // of heels and toes on the ground
    std::vector<FootContacts> contacts;                    // per frame
    std::optional<RetargetFigures> source, before, after;  // as it was; as it is on the target
    std::string summary;                                   // one line for people
};

// The motion of the source's body on the target's. Where the feet have no ground (groundOf) it
// stays as it is.
//
// What is done, on the source's ground: the root's height and its way from where it is first are
// scaled by the legs' ratio; legs that would go into each other are spread; each stay of a heel or
// toe gets one place, the mean of where the scaled motion has it, with heel and toe of a foot as
// far apart as the foot is long; feet are moved there, back within .2 s before and after; soles
// below the ground are lifted; the root goes up and down so that the knees bend as they did, and
// down where a foot is out of reach; the legs follow by inverse kinematics, feet turned as the
// source's; hands as `reach` says; forearms and hands leave the body (girth.h).
Retargeted retarget(const Motion& motion, const Proportions& source, const Proportions& target,
                    const RetargetOptions& options = {});

// The figures of poses on a ground y = 0, with contacts; both of the same frames.
RetargetFigures figuresOf(const Proportions& source, std::span<const JointPose> sourcePoses,
                          const Proportions& body, std::span<const JointPose> poses,
                          std::span<const FootContacts> contacts, double fps);

// ---- for commands -------------------------------------------------------------------------------

// Who is to move: the body with its offsets, and its shape.
struct RetargetTarget {
    const BodyModel& body;
    const Betas& betas;
    bool learntFromIt = false;  // from frames of the very motion
};

struct RetargetSettings {
    bool on = true;
    std::filesystem::path contacts;  // a file; empty: they are found
    std::string reach = "proportion";
};

// The whole motion for that body, before frames are chosen of it. The source's body is the target's
// model in the motion's own shape, without the target's offsets, and with the joints of the
// motion's skeleton where it has one; coefficients of another model are left out, and the summary
// says so. The motion stays to the last bit
// where that is off, where it is of the same person (the same shape, or the frames that the target
// was learnt from), and where nothing distinguishes the bodies.
//
// InputErrors of the contacts' file, and where contacts are given and there is no ground.
Retargeted retargetTo(const RetargetTarget& target, Motion motion,
                      const RetargetSettings& settings);

}  // namespace doppel
