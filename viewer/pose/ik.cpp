#include "viewer/pose/ik.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "viewer/pose/ik_problem.h"

namespace doppel {

namespace {

// The target is led from where the joint began to its place by steps of so many metres, while
// joints resist much: of all the ways to bend a limb there is one then. There they resist less and
// less.
constexpr double kLeadingStep = .05, kLeadingEase = .3;
constexpr std::array<double, 4> kRounds = {.1, .03, .01, .003};
constexpr int kLeadingSteps = 12, kSteps = 60;  // of the search, in each of these at most
// What is nearer than this to where it sticks, radians or metres, is there.
constexpr double kAtRest = 1e-9;

constexpr double kLeastGain = 1e-15;  // square metres, with which a step is worth another
constexpr double kLeastStep = 1e-6;   // radians or metres
constexpr double kLongestTurn = .5;   // radians per step and number
// A straight limb does not know which way to give: its hinge is bent by so little first.
// One that a capture bent backwards by less than this is put right when it is asked to give; by
// more, it stays.
constexpr double kFirstBend = .03, kBentBackwards = -.2;
// How far it is bent to see whether that is better, and by which share of the cost it has to be.
constexpr double kTriedBend = .5, kWorthAnother = 1e-4;

bool isFinite(const glm::dvec3& v) {
    return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

class Solver : IkProblem {
public:
    Solver(const Skeleton& skeleton, const Pose& began, std::span<const IkTarget> targets,
           const IkOptions& options)
        : IkProblem(skeleton, began, targets, options) {}

    bool moves() const { return unknowns_ > 0; }

    void solve() {
        if (farthest() < 1e-9) return;
        lead();
        for (double ease : kRounds) {
            ease_ = ease;
            descend(kSteps);
            if (ease == kRounds[0]) giveWhereStraight();
        }
        if (options_.limits) {
            for (const Mover& mover : movers_)
                if (!mover.place)
                    now_.turn[mover.joint] = limited(mover.joint, now_.turn[mover.joint]);
            place(now_);
        }
        keepOrientations();
    }

    // The joints that were turned; all others are as the drag began.
    Pose result(const Pose& began) const {
        Pose pose = began;
        for (const Mover& mover : movers_) {
            if (mover.place) pose.trans = now_.trans;
        }
        for (size_t j = 0; j < joint::kCount; ++j)
            if (now_.turn[j] != began_[j]) pose.rotation[j] = axisAngleOf(now_.turn[j]);
        return pose;
    }

private:
    void lead() {
        const std::vector<IkTarget> goals = targets_;
        std::vector<glm::dvec3> from;
        double longest = 0;
        for (const IkTarget& goal : goals) {
            from.push_back(now_.position[goal.joint]);
            longest = std::max(longest, glm::distance(from.back(), goal.position));
        }
        ease_ = kLeadingEase;
        const int count = std::max(1, static_cast<int>(std::ceil(longest / kLeadingStep)));
        for (int i = 1; i <= count; ++i) {
            for (size_t t = 0; t < goals.size(); ++t)
                targets_[t].position =
                    i == count || from[t] == goals[t].position
                        ? goals[t].position
                        : glm::mix(from[t], goals[t].position, double(i) / count);
            // The way may have led past where the limb is straight.
            bendStraightHinges();
            descend(kLeadingSteps);
        }
    }

    // The step for this damping. Where it would pass a limit that is not felt yet, that is put into
    // its way and the step found again. Nothing where the second derivatives make no valley.
    bool step(const Matrix& hessian, const Vector& descent, double damping, State& state,
              double& size) const {
        Matrix matrix = hessian;
        Vector right = descent;
        for (int i = 0; i < unknowns_; ++i) matrix(i, i) += damping;
        std::vector<std::array<bool, 3>> stopped(movers_.size(), {false, false, false});
        for (int attempt = 0;; ++attempt) {
            const Eigen::LLT<Matrix> factors(matrix);
            if (factors.info() != Eigen::Success) return false;
            Vector delta = factors.solve(right);
            const double longest = delta.cwiseAbs().maxCoeff();
            if (longest > kLongestTurn) delta *= kLongestTurn / longest;
            size = delta.cwiseAbs().maxCoeff();
            state = moved(delta);
            if (attempt == 3 || !options_.limits) break;
            bool more = false;
            for (size_t m = 0; m < movers_.size(); ++m) {
                const Mover& mover = movers_[m];
                const size_t j = mover.joint;
                if (mover.place || j == joint::kPelvis) continue;
                const auto after = beyondLimits(j, state.turn[j], began_[j]);
                if (std::ranges::none_of(after, [](double by) { return by > 0; })) continue;
                const auto before = beyondLimits(j, now_.turn[j], began_[j]);
                for (size_t limit = 0; limit < after.size(); ++limit) {
                    // One that is passed already is in the second derivatives.
                    if (after[limit] <= 0 || before[limit] > 0 || stopped[m][limit]) continue;
                    more = stopped[m][limit] = true;
                    addLimit(matrix, right, mover, limit, before[limit]);
                }
            }
            if (!more) break;
        }
        place(state);
        return true;
    }

    void descend(int steps) {
        Matrix hessian;
        Vector descent;
        double value = cost(now_);
        comeToRest(now_, value);
        for (int i = 0; i < steps; ++i) {
            linearise(hessian, descent);
            bool better = false;
            double size = 0, gain = 0;
            for (int attempt = 0; attempt < 9 && !better; ++attempt) {
                State next;
                const bool found = step(hessian, descent, damping_, next, size);
                const double nextValue = found ? cost(next) : INFINITY;
                better = nextValue < value;
                if (better) {
                    gain = value - nextValue;
                    const State before = now_;
                    now_ = next;
                    value = nextValue;
                    comeToRest(before, value);
                    damping_ = std::max(damping_ * .1, 1e-9);
                } else {
                    if (found && size < kLeastStep) break;
                    damping_ = std::min(damping_ * 10, 1e2);
                }
            }
            if (!better || size < kLeastStep || gain < kLeastGain + 1e-12 * value) break;
        }
        damping_ = 1e-6;
    }

    // Movers that have come back nearly to where they stick, or past it, go there, where that costs
    // less.
    void comeToRest(const State& before, double& value) {
        for (const Mover& mover : movers_) {
            const double far = mover.sticking > 0 ? glm::length(away(mover, now_)) : 0;
            if (far == 0) continue;
            const bool past = glm::dot(away(mover, now_), away(mover, before)) < 0;
            if (far > kFirstSlip && !past) continue;
            State rest = now_;
            if (mover.place)
                rest.trans = beganTrans_;
            else
                rest.turn[mover.joint] = began_[mover.joint];
            place(rest);
            const double found = cost(rest);
            if (found > value && far > kAtRest) continue;
            now_ = rest;
            value = found;
        }
    }

    // Whether there are any.
    bool bendStraightHinges(double to = kFirstBend) {
        bool found = false;
        for (const Mover& mover : movers_) {
            if (mover.count != 1) continue;
            glm::dquat& turn = now_.turn[mover.joint];
            const double flexion = bendOf(mover.joint, turn).flexion;
            if (flexion >= kFirstBend || flexion < kBentBackwards) continue;
            turn = limited(mover.joint, quaternionOf((to - flexion) * mover.axes[0]) * turn);
            found = true;
        }
        place(now_);
        return found;
    }

    // The search may have come to a straight limb where a bent one would do, and then the trunk
    // gives in its place: whether the limb is bent is tried from there.
    void giveWhereStraight() {
        const State straight = now_;
        const double value = cost(now_);
        if (!bendStraightHinges(kTriedBend)) return;
        descend(kSteps);
        if (cost(now_) > value - kWorthAnother * value) now_ = straight;
    }

    void keepOrientations() {
        for (const IkTarget& target : shakenPins_) {
            const size_t j = target.joint;
            // A joint that turns to bring another one to its target is not free.
            const bool busy = std::any_of(movers_.begin(), movers_.end(),
                                          [&](const Mover& m) { return m.joint == j; });
            if (busy) continue;
            const auto parent = static_cast<size_t>(skeleton_.parents[j]);
            const glm::dquat kept =
                glm::conjugate(now_.global[parent]) * glm::quat_cast(target.orientation);
            now_.turn[j] = limited(j, glm::normalize(kept));
        }
    }

    double damping_ = 1e-6;
};

}  // namespace

IkTarget pinnedAt(const PosedSkeleton& posed, size_t joint) {
    CHECK(joint < joint::kCount, "joint {} is one of {}", joint, kJointCount);
    return {joint, posed.position[joint], 100, true, posed.rotation[joint]};
}

Pose solveIk(const Skeleton& skeleton, const Pose& began, std::span<const IkTarget> targets,
             const IkOptions& options) {
    if (!isFinite(began)) return began;
    for (const IkTarget& target : targets) {
        CHECK(target.joint < joint::kCount, "joint {} is one of {}", target.joint, kJointCount);
        if (!isFinite(target.position) || !(target.weight > 0) || !std::isfinite(target.weight))
            return began;
    }
    Solver solver(skeleton, began, targets, options);
    if (!solver.moves()) return began;
    solver.solve();
    return solver.result(began);
}

}  // namespace doppel
