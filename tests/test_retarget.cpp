// Motion from one body to another: each thing that is done, and the whole on bodies of other betas.
#include "trainer/motion/retarget/retarget.h"

#include <gtest/gtest.h>

#include <cmath>

#include "engine/error.h"
#include "tests/bvh_text.h"
#include "tests/walking_person.h"
#include "trainer/data/random.h"
#include "trainer/motion/retarget/feet.h"
#include "trainer/motion/retarget/girth.h"
#include "trainer/motion/retarget/hands.h"
#include "trainer/motion/session.h"
#include "trainer/motion/upright.h"

namespace doppel {
namespace {

using namespace test;

const BodyModel& model() {
    static const BodyModel body = defaultBody();
    return body;
}

Betas shaped(std::initializer_list<std::pair<size_t, float>> values) {
    Betas betas{};
    for (const auto& [k, value] : values) betas[k] = value;
    return betas;
}
// Legs of .58, .75 and .93 m; and a body of the mean's height, with more girth.
const Betas kShort = shaped({{0, -2.5f}}), kMean{}, kTall = shaped({{0, 2.5f}}),
            kHeavy = shaped({{3, 2.5f}, {6, -3.f}, {7, 3.f}});

const Proportions& body(const Betas& betas) {
    static std::vector<std::pair<Betas, Proportions>> known;
    for (const auto& [of, proportions] : known)
        if (of == betas) return proportions;
    known.reserve(32);  // references stay
    known.emplace_back(betas, proportionsOf(model(), betas));
    return known.back().second;
}

double noise(uint64_t seed, uint64_t number) {  // deviation 1
    double sum = 0;
    for (uint64_t k = 0; k < 12; ++k) sum += uniformOf(seed, 12 * number + k);
    return sum - 6;
}

// As an estimator sees it: places off by `metres`, joints by `radians`, each frame anew.
void addNoise(Motion& motion, double metres, double radians, uint64_t seed) {
    uint64_t number = 0;
    for (size_t f = 0; f < motion.size(); ++f) {
        for (float& x : motion.trans[f]) x += static_cast<float>(metres * noise(seed, number++));
        for (size_t j = 0; j < joint::kCount; ++j) {
            const glm::dvec3 turn(noise(seed, number), noise(seed, number + 1),
                                  noise(seed, number + 2));
            number += 3;
            setJointRotation(motion.theta[f], j,
                             quaternionOf(radians * turn) * jointRotation(motion.theta[f], j));
        }
    }
}

void moveAll(Motion& motion, const RigidMotion& by) {
    for (size_t f = 0; f < motion.size(); ++f) movePose(by, motion.theta[f], motion.trans[f]);
}

// From a world with y up before a camera that looks down by `pitch` and is turned by `roll`.
RigidMotion cameraAt(double pitch, double roll, double height, double distance) {
    const glm::dquat turn = glm::angleAxis(roll, glm::dvec3(0, 0, 1)) *
                            glm::angleAxis(pitch, glm::dvec3(1, 0, 0)) * glm::dquat(0, 1, 0, 0);
    return {glm::mat3_cast(turn), turn * glm::dvec3(0, -height, 0) + glm::dvec3(0, 0, distance)};
}

double degrees(double radians) { return radians * 180 / M_PI; }

void expectSameBytes(const Motion& a, const Motion& b) {
    EXPECT_EQ(a.theta, b.theta);
    EXPECT_EQ(a.trans, b.trans);
}

std::string shown(const RetargetFigures& f) {
    return fmt::format(
        "slide {:.2f} height {:.2f} sunk {:.2f} deepest {:.2f} overlap {:.2f} touch {:.2f} wrong "
        "contacts {:.1f} acceleration {:.2f} sharpest {:.1f}",
        f.slide, f.height, f.sunk, f.deepest, f.overlap, f.touch, f.wrongContacts, f.acceleration,
        f.sharpest);
}

std::string shown(const Retargeted& r) {
    return fmt::format("{}\nsource {}\nbefore {}\nafter  {}", r.summary, shown(*r.source),
                       shown(*r.before), shown(*r.after));
}

// ---- limbs --------------------------------------------------------------------------------------

TEST(Retarget, TwoBonesReachAGoalAndKeepHandAndFoot) {
    const Proportions& p = body(kMean);
    uint64_t number = 0;
    for (const Limb& limb : {legOf(0), legOf(1), armOf(0), armOf(1)})
        for (int trial = 0; trial < 50; ++trial) {
            JointPose pose;
            for (auto& turn : pose.local) {
                turn = quaternionOf(
                    .25 * glm::dvec3(noise(3, number), noise(3, number + 1), noise(3, number + 2)));
                number += 3;
            }
            pose.local[limb.middle] = glm::angleAxis(.3 + .02 * trial, limb.hinge);
            const PlacedJoints before = placed(p, pose);
            JointPose same = pose;
            reach(p, limb, before.place[limb.end], same);
            const glm::dvec3 root = before.place[limb.root];
            const double length = lengthOf(p, limb);
            const glm::dvec3 towards = glm::normalize(before.place[limb.end] - root);
            const glm::dvec3 aside = glm::normalize(
                glm::dvec3(noise(4, number), noise(4, number + 1), noise(4, number + 2)));
            const glm::dvec3 direction = glm::normalize(towards + .5 * aside);
            const bool near = trial % 5 != 0;
            const glm::dvec3 goal = root + direction * (length * (near ? .5 + .009 * trial : 1.3));
            reach(p, limb, goal, pose);
            const PlacedJoints after = placed(p, pose);
            EXPECT_LT(glm::distance(after.place[limb.end], near ? goal : root + direction * length),
                      near ? 1e-9 : 1e-3);
            EXPECT_NEAR(std::abs(glm::dot(after.turn[limb.end], before.turn[limb.end])), 1, 1e-12);
            // Knees and elbows bend the way they do.
            const glm::dvec3 axis = glm::cross(after.place[limb.middle] - root,
                                               after.place[limb.end] - after.place[limb.middle]);
            EXPECT_GE(glm::dot(axis, after.turn[limb.root] * limb.hinge), near ? 1e-6 : -1e-3);
        }
}

TEST(Retarget, AReachedGoalChangesNothing) {
    const Proportions& p = body(kMean);
    for (const Limb& limb : {legOf(0), armOf(1)})
        for (const double bent : {.1, .5, 1.5}) {
            JointPose pose;
            for (auto& turn : pose.local) turn = glm::dquat(1, 0, 0, 0);
            pose.local[limb.middle] = glm::angleAxis(bent, limb.hinge);
            JointPose same = pose;
            reach(p, limb, placed(p, pose).place[limb.end], same);
            for (const size_t j : {limb.root, limb.middle, limb.end})
                EXPECT_NEAR(std::abs(glm::dot(same.local[j], pose.local[j])), 1, 1e-12) << bent;
        }
}

TEST(Retarget, WhatSmoothsAboveIsNowhereBelow) {
    std::vector<double> values(60);
    for (size_t i = 0; i < values.size(); ++i)
        values[i] = std::max(0., noise(9, i)) * (i % 7 == 0 ? 1 : 0);
    const auto above = smoothAbove(values, 1.5);
    for (size_t i = 0; i < values.size(); ++i) EXPECT_GE(above[i], values[i] - 1e-12) << i;
    EXPECT_EQ(smoothAbove(std::vector<double>(20), 2), std::vector<double>(20));
}

// ---- the ground ---------------------------------------------------------------------------------

TEST(Retarget, TheGroundOfAWorldIsLevel) {
    const Walk walk = walkOf(body(kMean), kMean);
    const auto ground = groundOf(walk.motion, body(kMean));
    ASSERT_TRUE(ground);
    EXPECT_EQ(ground->rotation, glm::dmat3(1));
    EXPECT_NEAR(ground->translation.y, 0, 2e-3);
    // Of a world with z up, half a metre higher.
    Motion other = walk.motion;
    moveAll(other, {glm::mat3_cast(glm::angleAxis(M_PI / 2, glm::dvec3(1, 0, 0))), {0, 0, .5}});
    const auto raised = groundOf(other, body(kMean));
    ASSERT_TRUE(raised);
    EXPECT_LT(glm::distance(raised->rotation * glm::dvec3(0, 0, 1), glm::dvec3(0, 1, 0)), 1e-9);
    EXPECT_NEAR(raised->translation.y, -.5, 2e-3);
}

TEST(Retarget, ATiltedCameraSeesTheGroundThatFeetStandOn) {
    WalkOptions o;
    o.frames = 240;
    o.turn = .7;
    for (const double lean : {0., .35}) {
        Walk walk = walkOf(body(kMean), kMean, o);
        for (Theta& theta : walk.motion.theta)  // bent forwards all the time, as over a pram
            setJointRotation(theta, joint::kSpine1, quaternionOf({lean, 0, 0}));
        addNoise(walk.motion, .008, .01, 5);
        const RigidMotion camera = cameraAt(14 * M_PI / 180, 4 * M_PI / 180, 1.4, 4);
        moveAll(walk.motion, camera);
        const auto ground = groundOf(walk.motion, body(kMean));
        ASSERT_TRUE(ground);
        const glm::dvec3 up = camera.rotation * glm::dvec3(0, 1, 0);
        const double off = degrees(std::acos(std::min(1., (ground->rotation * up).y)));
        EXPECT_LT(off, 1.5) << "lean " << lean;
        const glm::dvec3 origin = ground->rotation * camera.translation + ground->translation;
        EXPECT_NEAR(origin.y, 0, .03) << "lean " << lean;
    }
}

TEST(Retarget, AMotionWithoutAGroundStaysAsItIs) {
    Motion motion = walkOf(body(kMean), kMean).motion;
    for (size_t f = 0; f < motion.size(); ++f)  // climbing
        motion.trans[f][1] += .02f * static_cast<float>(f);
    EXPECT_FALSE(groundOf(motion, body(kMean)));
    const Retargeted result = retarget(motion, body(kMean), body(kTall));
    EXPECT_FALSE(result.changed);
    EXPECT_EQ(result.summary, "the feet have no ground in it, so the motion stays as it is");
    expectSameBytes(result.motion, motion);
    RetargetOptions options;
    options.contacts.emplace(motion.size());
    EXPECT_EQ(messageOf<InputError>([&] { retarget(motion, body(kMean), body(kTall), options); }),
              "--contacts: expected a motion whose feet stand on a ground, found none in walk");
}

// ---- contacts -----------------------------------------------------------------------------------

TEST(Retarget, FindsContactsAtAnyRateAndThroughNoise) {
    for (const double fps : {24., 30., 60., 120.})
        for (const double metres : {0., .006}) {
            WalkOptions o;
            o.fps = fps;
            o.frames = static_cast<size_t>(4 * fps);
            o.heelRise = .5;
            Walk walk = walkOf(body(kMean), kMean, o);
            Motion motion = walk.motion;
            addNoise(motion, metres, metres > 0 ? .01 : 0, 11);
            const auto poses = onGround(motion, body(kMean), {});
            const auto found = findContacts(poses, body(kMean), fps);
            size_t wrong = 0;
            std::array<int, 4> runs{}, trueRuns{};
            for (size_t f = 0; f < found.size(); ++f)
                for (size_t k = 0; k < 4; ++k) {
                    wrong += found[f][k] != walk.contacts[f][k];
                    runs[k] += found[f][k] && (f == 0 || !found[f - 1][k]);
                    trueRuns[k] += walk.contacts[f][k] && (f == 0 || !walk.contacts[f - 1][k]);
                }
            const double share = double(wrong) / double(4 * found.size());
            EXPECT_LT(share, .13) << fps << " a second, noise " << metres;
            EXPECT_EQ(runs, trueRuns) << fps << " a second, noise " << metres;
        }
}

TEST(Retarget, KeepsTheFeetThatAFileSaysStand) {
    // On a treadmill that is not told: every foot slides, so none is found to stand.
    const auto session = actorSession(0, 96, 3);
    Motion motion;
    motion.fps = 24;
    for (size_t f = 0; f < 96; ++f) {
        motion.theta.push_back(session[f].theta);
        motion.trans.push_back(session[f].trans);
    }
    RetargetOptions given;
    given.contacts.emplace(motion.size());
    for (size_t f = 24; f < 31; ++f) (*given.contacts)[f][1] = 1;
    const auto toeMoves = [&](const RetargetOptions& options) {
        const Retargeted result = retarget(motion, body(kMean), body(kShort), options);
        const auto ground = groundOf(motion, body(kMean));
        const auto places =
            contactPlaces(onGround(result.motion, body(kShort), *ground), body(kShort));
        double most = 0;
        for (size_t f = 25; f < 31; ++f)
            most = std::max(most, glm::distance(places[f][1], places[f - 1][1]));
        return most;
    };
    EXPECT_GT(toeMoves({}), .01);
    EXPECT_LT(toeMoves(given), .004);
}

// ---- feet ---------------------------------------------------------------------------------------

TEST(Retarget, TheRootGoesDownWhereAFootIsOutOfReach) {
    const Proportions& p = body(kMean);
    const double sole = p.soles[0].heel.y;
    std::vector<JointPose> standing(60);
    for (JointPose& pose : standing) {
        for (auto& turn : pose.local) turn = glm::dquat(1, 0, 0, 0);
        pose.pelvis = p.rest[0] - glm::dvec3(0, sole, 0);
    }
    std::vector<JointPose> poses = standing;
    for (size_t f = 0; f < poses.size(); ++f) {
        // One hip goes up by four centimetres, the other one down.
        const double bump = std::exp(-std::pow((double(f) - 30) / 8, 2));
        poses[f].local[0] = glm::angleAxis(.5 * bump, glm::dvec3(0, 0, 1));
        for (const size_t ankle : {joint::kLeftAnkle, joint::kRightAnkle})
            poses[f].local[ankle] = glm::conjugate(poses[f].local[0]);
    }
    const std::vector<JointPose> before = poses;
    const std::vector<FootContacts> contacts(60, FootContacts{1, 1, 1, 1});
    keepFeet(p, standing, contacts, false, p, poses, 30);
    const auto figures = figuresOf(p, standing, p, poses, contacts, 30);
    EXPECT_LT(poses[30].pelvis.y, before[30].pelvis.y - .01);
    EXPECT_LT(figures.height, 3) << shown(figures);
    EXPECT_LT(figures.slide, .5) << shown(figures);
    EXPECT_LT(figures.sharpest, 2 * figuresOf(p, standing, p, before, contacts, 30).sharpest + 1);
}

struct Case {
    const char* name;
    const Betas *from, *to;
};
const std::vector<Case> kCases = {{"tall to short", &kTall, &kShort},
                                  {"short to tall", &kShort, &kTall},
                                  {"mean to heavy", &kMean, &kHeavy},
                                  {"tall to heavy", &kTall, &kHeavy}};

// % of the moments of heels and toes at which one is found to stand that does not in the walk,
// whose contacts are known, or the other way round.
double wrongMoments(const Motion& motion, const Betas& betas, const Walk& walk,
                    const Betas& walker) {
    const auto ground = groundOf(walk.motion, body(walker));
    const auto found =
        findContacts(onGround(motion, body(betas), *ground), body(betas), walk.motion.fps);
    double wrong = 0;
    for (size_t f = 0; f < found.size(); ++f)
        for (size_t k = 0; k < 4; ++k) wrong += found[f][k] != walk.contacts[f][k];
    return 100 * wrong / double(4 * found.size());
}

TEST(Retarget, FeetOfOtherBodiesStandAndDoNotPop) {
    for (const Case& c : kCases)
        for (const bool noisy : {false, true}) {
            WalkOptions o;
            o.heelRise = .5;
            o.stride = *c.from == kShort ? .5 : .62;
            Walk walk = walkOf(body(*c.from), *c.from, o);
            if (noisy) addNoise(walk.motion, .004, .008, 21);
            const Retargeted result = retarget(walk.motion, body(*c.from), body(*c.to));
            ASSERT_TRUE(result.changed);
            const RetargetFigures &before = *result.before, &after = *result.after;
            const std::string what =
                fmt::format("{}{}\n{}", c.name, noisy ? ", noisy" : "", shown(result));
            std::printf("%s\n", what.c_str());  // the figures of docs/results.md
            EXPECT_LT(after.slide, before.slide / (noisy ? 4 : 5)) << what;
            EXPECT_LT(after.height, std::max(9., before.height / 10)) << what;
            EXPECT_LT(after.deepest, 1.) << what;
            EXPECT_LT(after.acceleration,
                      1.15 * std::max(before.acceleration, result.source->acceleration))
                << what;
            EXPECT_LT(after.sharpest, 1.5 * std::max(before.sharpest, result.source->sharpest))
                << what;
            EXPECT_NEAR(double(result.stays), 17, noisy ? 3 : 0) << what;
            const double found = wrongMoments(walk.motion, *c.from, walk, *c.from),
                         made = wrongMoments(result.motion, *c.to, walk, *c.from);
            std::printf(
                "contacts other than the walk's: %.1f %% found in it, %.1f %% in what was "
                "made of it\n",
                found, made);
            EXPECT_LT(made, 14) << what;
        }
}

TEST(Retarget, TheRootIsAsFastAsTheLegsAreLong) {
    const Walk walk = walkOf(body(kTall), kTall);
    const Retargeted result = retarget(walk.motion, body(kTall), body(kShort));
    const double ratio = body(kShort).legLength() / body(kTall).legLength();
    EXPECT_EQ(result.rootScale, ratio);
    const auto length = [](const Motion& motion) {
        return static_cast<double>(motion.trans.back()[2] - motion.trans.front()[2]);
    };
    EXPECT_NEAR(length(result.motion) / length(walk.motion), ratio, 1e-5);
    // Knees are as bent as they were.
    for (size_t f = 10; f < 100; f += 10)
        for (const size_t knee : {joint::kLeftKnee, joint::kRightKnee}) {
            const auto bent = [&](const Motion& motion) {
                return degrees(glm::length(axisAngleOf(jointRotation(motion.theta[f], knee))));
            };
            EXPECT_NEAR(bent(result.motion), bent(walk.motion), 9) << f;
        }
}

TEST(Retarget, WhatTheSessionDoesNeitherFloatsNorSinks) {
    for (const Betas* to : {&kShort, &kTall, &kHeavy}) {
        Motion motion;
        motion.fps = 24;
        for (const MotionFrame& frame : oneTake(192, 3)) {
            motion.theta.push_back(frame.theta);
            motion.trans.push_back(frame.trans);
        }
        const Retargeted result = retarget(motion, body(kMean), body(*to));
        ASSERT_TRUE(result.changed);
        EXPECT_LT(result.after->deepest, 2) << shown(result);
        EXPECT_LT(result.after->height, std::max(9., .25 * result.before->height)) << shown(result);
        EXPECT_LT(result.after->acceleration, 1.6 * result.source->acceleration) << shown(result);
    }
}

// ---- spaces -------------------------------------------------------------------------------------

TEST(Retarget, ItIsTheSameInEverySpace) {
    WalkOptions o;
    o.turn = .7;
    const Walk walk = walkOf(body(kTall), kTall, o);
    const Retargeted there = retarget(walk.motion, body(kTall), body(kShort));
    Motion moved = walk.motion;
    const RigidMotion camera = cameraAt(0, 0, 1.4, 4);
    moveAll(moved, camera);
    Motion expected = there.motion;
    moveAll(expected, camera);
    Retargeted here = retarget(moved, body(kTall), body(kShort));
    const auto furthest = [&](const Motion& one, const Motion& other) {
        double most = 0;
        for (size_t f = 0; f < one.size(); ++f)
            for (size_t c = 0; c < 3; ++c)
                most = std::max(most, std::abs(double(one.trans[f][c] - other.trans[f][c])));
        return most;
    };
    EXPECT_LT(furthest(here.motion, expected), .03);
    EXPECT_NEAR(here.after->slide, there.after->slide, .2);
    // A camera that moves: its poses are the still one's in each frame's own space.
    Motion filmed = walk.motion;
    for (size_t f = 0; f < filmed.size(); ++f) {
        filmed.views.push_back(cameraAt(.002 * double(f), .1, 1.4, 4 + .01 * double(f)));
        filmed.cameras.push_back({500, 500, 250, 250, 500, 500});
        movePose(filmed.views[f], filmed.theta[f], filmed.trans[f]);
    }
    Motion undone = walk.motion;
    undone.cameras = filmed.cameras;
    Retargeted still = retarget(walk.motion, body(kTall), body(kShort));
    const auto ground = groundOf(filmed, body(kTall));
    ASSERT_TRUE(ground);
    Retargeted seen = retarget(filmed, body(kTall), body(kShort));
    EXPECT_LT(seen.after->slide, 1) << shown(seen);
    EXPECT_LT(seen.after->deepest, 1) << shown(seen);
    EXPECT_NEAR(seen.after->slide, still.after->slide, .3);
}

// ---- hands and girth ----------------------------------------------------------------------------

TEST(Retarget, HandsReachTheSamePointsInSpace) {
    const Betas smaller = shaped({{0, -.8f}});
    Walk walk = walkOf(body(kMean), kMean);
    for (Theta& theta : walk.motion.theta)
        for (size_t side : {0, 1})
            setJointRotation(theta, joint::kLeftElbow + side,
                             glm::angleAxis(side == 0 ? -1.3 : 1.3, glm::dvec3(0, 1, 0)));
    const auto theirs = onGround(walk.motion, body(kMean), {});
    // How far knuckles are from where the source's are, seen from the root's place on the ground.
    const auto off = [&](Reach reach) {
        RetargetOptions options;
        options.reach = reach;
        const Retargeted result = retarget(walk.motion, body(kMean), body(smaller), options);
        const auto ours = onGround(result.motion, body(smaller), {});
        double least = INFINITY, most = 0;
        for (size_t f = 0; f < ours.size(); ++f) {
            const PlacedJoints a = placed(body(kMean), theirs[f]),
                               b = placed(body(smaller), ours[f]);
            for (size_t side : {0, 1}) {
                const size_t hand = joint::kLeftHand + side;
                const glm::dvec3 from(1, 0, 1);
                const double away = glm::distance(a.place[hand] - from * a.place[joint::kPelvis],
                                                  b.place[hand] - from * b.place[joint::kPelvis]);
                least = std::min(least, away);
                most = std::max(most, away);
            }
        }
        return std::pair(least, most);
    };
    EXPECT_LT(off(Reach::Space).second, .006);
    EXPECT_GT(off(Reach::Proportion).first, .03);
    EXPECT_EQ(messageOf<InputError>([] { reachNamed("far"); }),
              "--reach: expected proportion or space, found \"far\"");
    // Out of reach: arms end before they are straight, and do not jump.
    RetargetOptions options;
    options.reach = Reach::Space;
    const Retargeted result = retarget(walk.motion, body(kMean), body(kShort), options);
    EXPECT_LT(result.after->sharpest, 1.5 * result.source->sharpest) << shown(result);
}

// The mean body with arms and trunk of other lengths.
Proportions stretched(double arms, double broader) {
    auto rest = body(kMean).rest;
    for (size_t side : {0, 1}) {
        const glm::dvec3 shoulder = rest[joint::kLeftShoulder + side];
        for (const size_t j : {joint::kLeftElbow, joint::kLeftWrist, joint::kLeftHand})
            rest[j + side] = shoulder + arms * (rest[j + side] - shoulder);
        const glm::dvec3 out(broader * shoulder.x, 0, 0);
        for (const size_t j : {joint::kLeftCollar, joint::kLeftShoulder, joint::kLeftElbow,
                               joint::kLeftWrist, joint::kLeftHand})
            rest[j + side] += out;
    }
    return withJoints(body(kMean), rest);
}

// Somebody stands with one hand on the hip, and claps slowly with both from half of the time on.
Motion handsThatTouch() {
    Walk walk = walkOf(body(kMean), kMean, {.stride = .001});
    const Proportions& p = body(kMean);
    for (size_t f = 0; f < walk.poses.size(); ++f) {
        JointPose& pose = walk.poses[f];
        const double apart = f < 60 ? .3 : .14 + .13 * std::cos(2 * M_PI * double(f - 60) / 30);
        for (size_t side : {0, 1}) {
            const PlacedJoints joints = placed(p, pose);
            const double sign = side == 0 ? 1 : -1;
            glm::dvec3 goal = joints.place[joint::kSpine2] + glm::dvec3(sign * apart, 0, .36);
            if (side == 1 && f < 60)
                goal = joints.place[joint::kRightHip] + glm::dvec3(-.115, .1, 0);
            reach(p, armOf(side), goal, pose);
        }
    }
    fromGround(walk.poses, p, {}, walk.motion);
    return walk.motion;
}

TEST(Retarget, HandsThatTouchDoSoOnOtherProportions) {
    const Motion motion = handsThatTouch();
    struct Other {
        double arms, broader, most;  // mm; shorter arms do not reach all that longer ones did
    };
    for (const auto& [arms, broader, most] :
         {Other{1.2, 0, 8}, Other{.88, 0, 30}, Other{1, .12, 8}}) {
        const Proportions target = stretched(arms, broader);
        const Retargeted result = retarget(motion, body(kMean), target);
        const std::string what =
            fmt::format("hands that touch, arms of {:.0f} %, shoulders broader by {:.0f} %\n{}",
                        100 * arms, 100 * broader, shown(result));
        std::printf("%s\n", what.c_str());  // the figures of docs/results.md
        EXPECT_GT(result.before->touch, 15) << what;
        EXPECT_LT(result.after->touch, most) << what;
        EXPECT_LT(result.after->touch, .5 * result.before->touch) << what;
        EXPECT_LT(result.after->sharpest, 1.6 * result.source->sharpest) << what;
    }
    // On its own body a hand is where it was.
    const auto poses = onGround(motion, body(kMean), {});
    std::vector<JointPose> same = poses;
    touchAsTheSource(body(kMean), poses, body(kMean), same, 30);
    for (size_t f = 0; f < poses.size(); ++f)
        for (size_t j = 0; j < joint::kCount; ++j)
            EXPECT_NEAR(std::abs(glm::dot(same[f].local[j], poses[f].local[j])), 1, 1e-9);
}

TEST(Retarget, WhatNothingTouchesStaysWhereRotationsTakeIt) {
    WalkOptions o;
    o.arms = .3;
    const Walk walk = walkOf(body(kMean), kMean, o);
    const Proportions target = stretched(1.2, 0);
    const auto theirs = onGround(walk.motion, body(kMean), {});
    std::vector<JointPose> poses = theirs;
    touchAsTheSource(body(kMean), theirs, target, poses, 30);
    for (size_t f = 0; f < poses.size(); ++f)
        for (const size_t j : {joint::kLeftShoulder, joint::kRightElbow})
            EXPECT_EQ(poses[f].local[j], theirs[f].local[j]);
}

// A skeleton of a file: arms a fifth longer than the simple person's, centimetres.
TEST(Retarget, ASkeletonTellsWhoMoved) {
    auto bones = person(false);
    for (Bone& bone : bones) {
        if (bone.name.ends_with("ForeArm") || bone.name.ends_with("Hand")) bone.offset *= 1.2;
        if (bone.name.ends_with("Arm") && !bone.name.ends_with("ForeArm")) bone.offset.x *= 1.5;
    }
    const std::vector<Angles> frames(60);
    const std::vector<glm::dvec3> places(60, glm::dvec3(0, .95, 0));
    const Motion motion = motionOf(bvhText(bones, frames, places, {.unit = .01}));
    ASSERT_TRUE(motion.skeleton);
    const auto& rest = motion.skeleton->rest;
    const double size = motion.skeleton->size;
    const auto length = [&](size_t from, size_t to) {
        return size * glm::distance(rest[from], rest[to]);
    };
    EXPECT_NEAR(length(joint::kLeftHip, joint::kLeftKnee), .4, 1e-6);
    EXPECT_NEAR(length(joint::kRightKnee, joint::kRightAnkle), .4, 1e-6);
    EXPECT_NEAR(length(joint::kLeftShoulder, joint::kLeftElbow), .28 * 1.2, 1e-6);
    EXPECT_NEAR(length(joint::kRightElbow, joint::kRightWrist), .25 * 1.2, 1e-6);
    EXPECT_NEAR(length(joint::kLeftShoulder, joint::kRightShoulder), 2 * (.05 + .18), 1e-6);
    EXPECT_NEAR(length(joint::kLeftHip, joint::kRightHip), .18, 1e-6);

    // In space hands are where the file has them, in metres, however long the legs are taken to be.
    RetargetSettings settings;
    settings.reach = "space";
    const Betas taller = shaped({{0, 1.2f}});
    const Retargeted result = retargetTo({model(), taller}, motion, settings);
    ASSERT_TRUE(result.changed);
    const auto ours = onGround(result.motion, body(taller), {});
    const PlacedJoints joints = placed(body(taller), ours[30]);
    // Ankles at .1 m in the file; soles are as far below them as the body's.
    const double theirs = .95 + .44 + .12 - (.95 - .05 - .8);
    EXPECT_NEAR(joints.place[joint::kLeftHand].y, theirs, .03);
    // As long as a T-pose of this body goes, the arms are straight without it.
    EXPECT_NEAR(result.rootScale, body(taller).legLength() / (.8 / size), 1e-3);
}

double meanOverlap(const std::vector<JointPose>& theirs, const std::vector<JointPose>& ours) {
    double sum = 0;
    for (size_t f = 0; f < ours.size(); ++f)
        sum += excessDepth(body(kMean), theirs[f], body(kHeavy), ours[f]);
    return 1000 * sum / double(ours.size());
}

double sharpest(const std::vector<JointPose>& poses) {
    return figuresOf(body(kHeavy), poses, body(kHeavy), poses,
                     std::vector<FootContacts>(poses.size()), 30)
        .sharpest;
}

TEST(Retarget, ArmsLeaveABodyThatIsThicker) {
    WalkOptions o;
    o.arms = 1.52;  // straight down
    const Walk walk = walkOf(body(kMean), kMean, o);
    std::vector<JointPose> poses = onGround(walk.motion, body(kHeavy), {});
    const std::vector<JointPose> before = poses;
    clearArms(body(kMean), walk.poses, body(kHeavy), poses, 30);
    EXPECT_GT(meanOverlap(walk.poses, before), 4);
    EXPECT_LT(meanOverlap(walk.poses, poses), meanOverlap(walk.poses, before) / 4);
    EXPECT_LT(sharpest(poses), 1.5 * sharpest(before));
    double turned = 0;
    for (size_t f = 0; f < poses.size(); ++f)
        for (const size_t j : {joint::kLeftShoulder, joint::kRightElbow})
            turned = std::max(turned, glm::length(axisAngleOf(glm::conjugate(before[f].local[j]) *
                                                              poses[f].local[j])));
    EXPECT_LT(degrees(turned), 20);
    // Of a body like the one that moved nothing does, however deep its limbs are in it.
    poses = walk.poses;
    clearArms(body(kMean), walk.poses, body(kMean), poses, 30);
    for (size_t f = 0; f < poses.size(); ++f) EXPECT_EQ(poses[f].local, walk.poses[f].local);
}

TEST(Retarget, LegsLeaveEachOther) {
    WalkOptions o;
    o.arms = .2;
    o.apart = -.08;
    const Walk walk = walkOf(body(kMean), kMean, o);
    std::vector<JointPose> poses = onGround(walk.motion, body(kHeavy), {});
    const std::vector<JointPose> before = poses;
    clearLegs(body(kMean), walk.poses, body(kHeavy), poses, 30);
    EXPECT_GT(meanOverlap(walk.poses, before), 4);
    EXPECT_LT(meanOverlap(walk.poses, poses), meanOverlap(walk.poses, before) / 4);
    EXPECT_LT(sharpest(poses), 1.5 * sharpest(before));
    // The feet are turned as they were.
    for (size_t f = 0; f < poses.size(); ++f) {
        const PlacedJoints was = placed(body(kHeavy), before[f]),
                           is = placed(body(kHeavy), poses[f]);
        EXPECT_NEAR(std::abs(glm::dot(was.turn[joint::kLeftAnkle], is.turn[joint::kLeftAnkle])), 1,
                    1e-9);
    }
}

// ---- for commands -------------------------------------------------------------------------------

// A stand-in for SMPL's body, which does not come with Doppel: of as many vertices and faces.
BodyModel asIfSmpl() {
    BodyModel smpl = model();
    smpl.modelVertices = 6890;
    smpl.modelFaces = 13776;
    return smpl;
}

TEST(Retarget, CoefficientsCountOnTheBodyWhoseTheyAre) {
    const BodyModel smpl = asIfSmpl();
    const auto of = [&](const char* type, double beta, const BodyModel& on) {
        Folder folder;
        const Motion walk = walkOf(body(kMean), kMean).motion;
        const auto frames = static_cast<int64_t>(walk.size());
        std::vector<double> poses, trans, betas(16);
        betas[0] = beta;
        for (size_t f = 0; f < walk.size(); ++f) {
            poses.insert(poses.end(), walk.theta[f].begin(), walk.theta[f].begin() + 66);
            poses.resize((f + 1) * 156);
            trans.insert(trans.end(), walk.trans[f].begin(), walk.trans[f].end());
        }
        Npz npz;
        npz.set("poses", Array::f64({frames, 156}, poses));
        npz.set("trans", Array::f64({frames, 3}, trans));
        npz.set("betas", Array::f64({16}, betas));
        npz.set("mocap_framerate", Array::scalarF64(30));
        npz.set("surface_model_type", Array::text(type));
        writeNpz(folder / "walk.npz", npz, true);
        RetargetSettings settings;
        settings.reach = "space";  // so that it is fitted to whoever it is
        return retargetTo({on, kMean}, readMotion(folder / "walk.npz"), settings);
    };
    const double tall = of("smplh", 2.5, smpl).rootScale,
                 little = of("smplh", -2.5, smpl).rootScale;
    EXPECT_NEAR(tall, body(kMean).legLength() / body(kTall).legLength(), 1e-6);
    EXPECT_NEAR(little, body(kMean).legLength() / body(kShort).legLength(), 1e-6);
    // On our own body, and SMPL-X's on SMPL's, they mean something else, and a line says so.
    for (const Retargeted& left : {of("smplh", 2.5, model()), of("smplx", 2.5, smpl)}) {
        EXPECT_NEAR(left.rootScale, 1, 1e-9);
        EXPECT_NE(left.summary.find("which mean something else to the avatar's body, and are left "
                                    "out"),
                  std::string::npos)
            << left.summary;
    }
}

TEST(Retarget, WrongContactsAreCounted) {
    WalkOptions o;
    o.heelRise = .5;
    const Walk walk = walkOf(body(kTall), kTall, o);
    const Retargeted result = retarget(walk.motion, body(kTall), body(kShort));
    EXPECT_GT(result.before->wrongContacts, 60) << shown(result);
    EXPECT_LT(result.after->wrongContacts, 20) << shown(result);
    EXPECT_EQ(result.source->wrongContacts, 0) << "found in the very motion";
}

TEST(Retarget, WhoseMotionItIsStaysToTheLastBit) {
    Motion motion = walkOf(body(kTall), kTall).motion;
    const auto to = [&](const Betas& betas, const RetargetSettings& settings = {},
                        bool learntFromIt = false) {
        return retargetTo({model(), betas, learntFromIt}, motion, settings);
    };
    EXPECT_TRUE(to(kShort).changed);
    EXPECT_EQ(to(kShort).summary.find("root scaled by 0.63, feet kept on the ground in "), 0u);
    RetargetSettings off;
    off.on = false;
    Betas nearly = kTall;
    nearly[0] += 1e-5f;
    // The last: frames that the avatar was learnt from, whose shape training has found better.
    for (const Retargeted& same : {to(kTall), to(kShort, off), to(nearly), to(kShort, {}, true)}) {
        EXPECT_FALSE(same.changed);
        EXPECT_EQ(same.summary, "");
        expectSameBytes(same.motion, motion);
    }
    // A person's own offsets count: the motion is of a body without them.
    motion.betas = {};
    BodyModel dressed = model();
    dressed.offsets.assign(dressed.templateVertices.size(), 0);
    for (size_t v = 0; v < dressed.part.size(); ++v)
        if (dressed.part[v] == BodyPart::kTorso) dressed.offsets[3 * v + 2] = .06f;
    EXPECT_TRUE(retargetTo({dressed, kMean}, motion, {}).changed);
    EXPECT_FALSE(retargetTo({model(), kMean}, motion, {}).changed);
    Folder folder;
    RetargetSettings given;
    given.contacts = folder / "c.json";
    folder.write("c.json", std::string(R"({"left_heel": [1]})"));
    EXPECT_EQ(messageOf<InputError>([&] { to(kShort, given); }),
              given.contacts.string() +
                  ": left_heel: expected 120 flags, one for each of the motion's frames, found 1");
}

}  // namespace
}  // namespace doppel
