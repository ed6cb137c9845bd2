#include "viewer/ik.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "engine/error.h"

namespace doppel {

namespace {

// Resistance to a turn, m² per rad²: what a turn by one radian costs in squared distance from the
// target. The ratios make the feel, a hand being moved by shoulder and elbow and the trunk
// following only where these have no more to give; the size keeps targets within a centimetre
// before the rounds of solve() close the rest.
double resistanceOf(size_t joint) {
    switch (joint) {
        case joint::kLeftElbow:
        case joint::kRightElbow:
        case joint::kLeftKnee:
        case joint::kRightKnee:
            return 3e-4;
        case joint::kLeftCollar:
        case joint::kRightCollar:
            return 2e-2;
        case joint::kSpine1:
        case joint::kSpine2:
        case joint::kSpine3:
            return 6e-2;
        case joint::kNeck:
        case joint::kHead:
            return 5e-3;
        case joint::kPelvis:
            return .3;
        default:
            return 1e-3;
    }
}
// The trunk sticks where the drag began, as if by dry friction: it stays there to the last bit
// until it is pulled as hard as would turn it by so many radians, or shift the pelvis by so many
// metres, without. What a limb reaches alone leaves it still, and nothing jumps where it begins to
// follow.
constexpr double kStickingTurn = .06, kStickingPlace = .02;
bool sticks(size_t joint) {
    return joint == joint::kSpine1 || joint == joint::kSpine2 || joint == joint::kSpine3 ||
           joint == joint::kPelvis;
}

// The pelvis's place, m² per m²: dragged itself, and giving way above pinned legs.
constexpr double kDraggedPlace = 1e-6, kGivingPlace = .5;

// Beyond this distance, metres, the pull of a target grows no more (Huber's loss): a cursor far
// away stretches the body towards it as one just out of reach does.
constexpr double kFarthestPull = .25;
// A round adds at most so much to a target.
constexpr double kFarthestShift = .03;
// From round to round joints resist less.
constexpr std::array<double, 4> kRounds = {.3, .03, .02, .02};

// What slips first goes so far, radians or metres; what is nearer than the other to where it sticks
// is there.
constexpr double kFirstSlip = .01, kAtRest = 1e-9;

constexpr double kLeastGain = 1e-11;  // square metres, with which a step is worth another
constexpr double kLongestTurn = .5;   // radians per step and number
constexpr int kMostUnknowns = 3 + static_cast<int>(kThetaSize);
// A straight limb does not know which way to give: its hinge is bent by so little first.
// One that a capture bent backwards by less than this is put right when it is asked to give; by
// more, it stays.
constexpr double kFirstBend = .03, kBentBackwards = -.2;

using Matrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostUnknowns, kMostUnknowns>;
using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostUnknowns, 1>;

bool isFinite(const glm::dvec3& v) {
    return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

glm::dvec3 shortened(const glm::dvec3& v, double length) {
    const double found = glm::length(v);
    return found > length ? v * (length / found) : v;
}

// One or three unknowns: turns of a joint about axes in its parent's frame, or the body's place.
struct Mover {
    size_t joint;
    bool place;
    int first, count;
    double resistance, sticking;
    std::array<glm::dvec3, 3> axes;
};

class Solver {
public:
    Solver(const Skeleton& skeleton, const Pose& start, const Pose& began,
           std::span<const IkTarget> targets, const IkOptions& options)
        : skeleton_(skeleton), options_(options), targets_(targets.begin(), targets.end()) {
        for (size_t j = 0; j < joint::kCount; ++j) {
            began_[j] = quaternionOf(began.rotation[j]);
            now_.turn[j] = quaternionOf(start.rotation[j]);
            beganRotation_[j] = began.rotation[j];
        }
        beganTrans_ = began.trans;
        now_.trans = start.trans;
        startTurn_ = now_.turn;
        findMovers();
        place(now_);
        for (IkTarget& target : targets_) {
            if (!target.pinned && !carried_)
                target.position = withinSight(target, skeleton.rest[0] + began.trans);
            aims_.push_back(target.position);
        }
    }

    bool moves() const { return unknowns_ > 0; }

    void solve() {
        if (farthest() < 1e-9 && displacement() < 1e-9) return;
        bendStraightHinges();
        for (double ease : kRounds) {
            ease_ = ease;
            descend();
            if (farthest() < options_.tolerance) break;
            for (size_t t = 0; t < targets_.size(); ++t)
                aims_[t] += shortened(missing(t), kFarthestShift);
        }
        keepOrientations();
    }

    // The joints that were turned; all others are those of `start`.
    Pose result(const Pose& start) const {
        Pose pose = start;
        for (const Mover& mover : movers_) {
            if (mover.place) pose.trans = now_.trans;
        }
        for (size_t j = 0; j < joint::kCount; ++j)
            if (now_.turn[j] != startTurn_[j])
                pose.rotation[j] =
                    now_.turn[j] == began_[j] ? beganRotation_[j] : axisAngleOf(now_.turn[j]);
        return pose;
    }

private:
    struct State {
        std::array<glm::dquat, joint::kCount> turn;  // in the parent's frame
        glm::dvec3 trans;
        std::array<glm::dquat, joint::kCount> global;
        std::array<glm::dvec3, joint::kCount> position;
    };

    void place(State& state) const {
        for (size_t j = 0; j < joint::kCount; ++j) {
            if (skeleton_.parents[j] < 0) {
                state.global[j] = state.turn[j];
                state.position[j] = skeleton_.rest[j] + state.trans;
                continue;
            }
            const auto parent = static_cast<size_t>(skeleton_.parents[j]);
            state.global[j] = state.global[parent] * state.turn[j];
            state.position[j] = state.position[parent] +
                                state.global[parent] * (skeleton_.rest[j] - skeleton_.rest[parent]);
        }
    }

    // A target not farther from the pelvis than a stretched body reaches, and a bit: beyond, only
    // the direction counts, and the search is the harder the farther a target is.
    glm::dvec3 withinSight(const IkTarget& target, const glm::dvec3& pelvis) const {
        double reach = .5;
        for (auto j = static_cast<int>(target.joint); j > 0; j = skeleton_.parents[size_t(j)])
            reach += glm::length(skeleton_.rest[size_t(j)] -
                                 skeleton_.rest[size_t(skeleton_.parents[size_t(j)])]);
        // Divided first: squares of what a double holds may be more than it holds.
        const glm::dvec3 way = target.position - pelvis;
        const double largest = std::max({std::abs(way.x), std::abs(way.y), std::abs(way.z)});
        if (largest <= reach) return pelvis + shortened(way, reach);
        return pelvis + shortened(way / largest * 2. * reach, reach);
    }

    void findMovers() {
        std::array<bool, joint::kCount> turns{};
        bool legPinned = false, pelvisPinned = false, pelvisMoves = false, pelvisDragged = false;
        const auto markAncestors = [&](size_t j) {
            for (int at = skeleton_.parents[j]; at > 0; at = skeleton_.parents[size_t(at)])
                turns[static_cast<size_t>(at)] = true;
        };
        for (const IkTarget& target : targets_) {
            if (target.pinned) {
                pelvisPinned |= target.joint == joint::kPelvis;
                for (size_t hip : {joint::kLeftHip, joint::kRightHip})
                    legPinned |= target.joint != hip && skeleton_.hangsOn(target.joint, hip);
                continue;
            }
            markAncestors(target.joint);
            pelvisDragged |= skeleton_.parents[target.joint] <= 0;
        }
        // A leg that is dragged while the other one is pinned does not take the body along.
        for (const IkTarget& target : targets_) {
            const bool ofLeg = skeleton_.hangsOn(target.joint, joint::kLeftHip) ||
                               skeleton_.hangsOn(target.joint, joint::kRightHip);
            if (!target.pinned && !ofLeg) pelvisMoves |= legPinned && !pelvisPinned;
        }
        pelvisMoves |= pelvisDragged;
        carried_ = pelvisDragged && !legPinned;
        for (const IkTarget& target : targets_) {
            if (!target.pinned) continue;
            // A pin's joints have work only where something under them moves.
            bool shaken = pelvisMoves;
            for (int at = skeleton_.parents[target.joint]; at > 0;
                 at = skeleton_.parents[size_t(at)])
                shaken |= turns[static_cast<size_t>(at)];
            if (!shaken) continue;
            markAncestors(target.joint);
            if (target.joint != joint::kPelvis) shakenPins_.push_back(target);
        }

        const auto add = [&](size_t j, bool place, double resistance) {
            const double sticking = place ? kStickingPlace : sticks(j) ? kStickingTurn : 0;
            Mover mover{j, place, unknowns_, 3, resistance, sticking, {}};
            mover.axes = {glm::dvec3(1, 0, 0), glm::dvec3(0, 1, 0), glm::dvec3(0, 0, 1)};
            if (!place && isHinge(j)) {
                // Bent sideways by a capture, a hinge goes on in the plane that it is bent in; a
                // straight one in the human way.
                const Bend bend = bendOf(j, began_[j]);
                constexpr double kClear = .1;
                mover.axes[0] = glm::normalize((std::max(bend.flexion, 0.) + kClear) * bend.axis +
                                               bend.sideways * bend.across);
                mover.count = 1;
            }
            unknowns_ += mover.count;
            movers_.push_back(mover);
        };
        if (pelvisMoves) {
            add(joint::kPelvis, true, pelvisDragged ? kDraggedPlace : kGivingPlace);
            if (!pelvisDragged) add(joint::kPelvis, false, resistanceOf(joint::kPelvis));
        }
        double least = INFINITY;
        for (size_t j = 1; j < joint::kCount; ++j) {
            if (!turns[j]) continue;
            add(j, false, resistanceOf(j));
            if (!isHinge(j)) least = std::min(least, resistanceOf(j));
        }
        // Where only stiff joints are asked (the trunk, by the neck) they do not resist either.
        if (!pelvisMoves && least > 1e-3 && std::isfinite(least))
            for (Mover& mover : movers_) mover.resistance *= 1e-3 / least;
    }

    glm::dvec3 missing(size_t t) const {
        return targets_[t].position - now_.position[targets_[t].joint];
    }
    double farthest() const {
        double worst = 0;
        for (size_t t = 0; t < targets_.size(); ++t)
            worst = std::max(worst, glm::length(missing(t)));
        return worst;
    }
    double displacement() const {
        double worst = 0;
        for (const Mover& mover : movers_) worst = std::max(worst, glm::length(away(mover, now_)));
        return worst;
    }

    // How far a mover is from where the drag began, in its parent's frame.
    glm::dvec3 away(const Mover& mover, const State& state) const {
        if (mover.place) return state.trans - beganTrans_;
        if (state.turn[mover.joint] == began_[mover.joint]) return glm::dvec3(0);  // exactly
        return axisAngleOf(state.turn[mover.joint] * glm::conjugate(began_[mover.joint]));
    }

    double cost(const State& state) const {
        double sum = 0;
        for (size_t t = 0; t < targets_.size(); ++t) {
            const double far = glm::length(aims_[t] - state.position[targets_[t].joint]);
            sum += targets_[t].weight * (far < kFarthestPull || targets_[t].pinned
                                             ? far * far
                                             : kFarthestPull * (2 * far - kFarthestPull));
        }
        for (const Mover& mover : movers_) {
            const glm::dvec3 d = away(mover, state);
            sum +=
                ease_ * mover.resistance * (glm::dot(d, d) + 2 * mover.sticking * glm::length(d));
        }
        return sum;
    }

    glm::dquat limited(size_t j, const glm::dquat& turn) const {
        return options_.limits ? clampJoint(j, turn, began_[j]) : turn;
    }

    // The axis of an unknown in the world.
    glm::dvec3 worldAxis(const Mover& mover, int k) const {
        const glm::dvec3& axis = mover.axes[static_cast<size_t>(k)];
        const int parent = skeleton_.parents[mover.joint];
        return mover.place || parent < 0 ? axis : now_.global[static_cast<size_t>(parent)] * axis;
    }

    // Half of the cost's second derivatives as Gauss and Newton take them, and of its gradient.
    void linearise(Matrix& hessian, Vector& descent) const {
        hessian.setZero(unknowns_, unknowns_);
        descent.setZero(unknowns_);
        Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMostUnknowns> jacobian;
        for (size_t t = 0; t < targets_.size(); ++t) {
            const size_t joint = targets_[t].joint;
            const glm::dvec3 error = aims_[t] - now_.position[joint];
            double weight = targets_[t].weight;
            const double far = glm::length(error);
            if (!targets_[t].pinned && far > kFarthestPull) weight *= kFarthestPull / far;
            jacobian.setZero(3, unknowns_);
            for (const Mover& mover : movers_) {
                if (!skeleton_.hangsOn(joint, mover.joint)) continue;
                const glm::dvec3 arm = now_.position[joint] - now_.position[mover.joint];
                for (int k = 0; k < mover.count; ++k) {
                    const glm::dvec3 axis = worldAxis(mover, k);
                    const glm::dvec3 column = mover.place ? axis : glm::cross(axis, arm);
                    for (int c = 0; c < 3; ++c) jacobian(c, mover.first + k) = column[c];
                }
            }
            hessian.noalias() += weight * jacobian.transpose() * jacobian;
            descent.noalias() +=
                weight * jacobian.transpose() * Eigen::Vector3d(error.x, error.y, error.z);
        }
        for (const Mover& mover : movers_) {
            const glm::dvec3 d = away(mover, now_);
            const double resistance = ease_ * mover.resistance, far = glm::length(d);
            if (far == 0 && mover.sticking > 0) {
                auto pull = descent.segment(mover.first, mover.count);
                const double held = resistance * mover.sticking;
                if (pull.norm() <= held) {
                    for (int i = mover.first; i < mover.first + mover.count; ++i) {
                        hessian.row(i).setZero();
                        hessian.col(i).setZero();
                        hessian(i, i) = 1;
                    }
                    pull.setZero();
                    continue;
                }
                pull *= 1 - held / pull.norm();
            }
            for (int k = 0; k < mover.count; ++k) {
                hessian(mover.first + k, mover.first + k) += resistance;
                descent(mover.first + k) -= resistance *
                                            (1 + (far > 0 ? mover.sticking / far : 0)) *
                                            glm::dot(mover.axes[static_cast<size_t>(k)], d);
            }
            if (mover.sticking == 0) continue;
            // Of the length: nothing along d, 1 / length across; near 0, where that would not hold
            // for a step, in every direction.
            const double curve = resistance * mover.sticking / std::max(far, kFirstSlip);
            const glm::dvec3 along = far > kFirstSlip ? d / far : glm::dvec3(0);
            for (int k = 0; k < mover.count; ++k)
                for (int l = 0; l < mover.count; ++l)
                    hessian(mover.first + k, mover.first + l) +=
                        curve * ((k == l ? 1 : 0) -
                                 glm::dot(mover.axes[static_cast<size_t>(k)], along) *
                                     glm::dot(mover.axes[static_cast<size_t>(l)], along));
        }
    }

    // Moves by delta.
    State moved(const Vector& delta) const {
        State state = now_;
        for (const Mover& mover : movers_) {
            glm::dvec3 by(0);
            for (int k = 0; k < mover.count; ++k)
                by += delta(mover.first + k) * mover.axes[static_cast<size_t>(k)];
            if (mover.place)
                state.trans += by;
            else
                state.turn[mover.joint] = glm::normalize(quaternionOf(by) * now_.turn[mover.joint]);
        }
        return state;
    }

    // The step for this damping, at limits along them: where it would pass one, the limit's
    // direction is taken from the joint and the rest is solved again.
    State step(const Matrix& hessian, const Vector& descent, double damping, double& size) const {
        // Against second derivatives of a square metre per square radian.
        constexpr double kStop = 1e4, kDifference = 1e-6;
        Matrix matrix = hessian;
        Vector right = descent;
        for (int i = 0; i < unknowns_; ++i) matrix(i, i) += damping;
        std::vector<std::array<bool, 3>> stopped(movers_.size(), {false, false, false});
        State state;
        for (int attempt = 0;; ++attempt) {
            Vector delta = matrix.llt().solve(right);
            const double longest = delta.cwiseAbs().maxCoeff();
            if (longest > kLongestTurn) delta *= kLongestTurn / longest;
            size = delta.cwiseAbs().maxCoeff();
            state = moved(delta);
            if (attempt == 3) break;
            bool more = false;
            for (size_t m = 0; m < movers_.size(); ++m) {
                const Mover& mover = movers_[m];
                const size_t j = mover.joint;
                if (!options_.limits || mover.place || j == joint::kPelvis) continue;
                const auto after = beyondLimits(j, state.turn[j], began_[j]);
                for (size_t limit = 0; limit < after.size(); ++limit) {
                    if (after[limit] < 1e-9 || stopped[m][limit]) continue;
                    more = stopped[m][limit] = true;
                    const double before = beyondLimits(j, now_.turn[j], began_[j])[limit];
                    Eigen::Vector3d slope(0, 0, 0);
                    for (int k = 0; k < mover.count; ++k) {
                        const glm::dquat near =
                            quaternionOf(kDifference * mover.axes[static_cast<size_t>(k)]) *
                            now_.turn[j];
                        slope[k] = (beyondLimits(j, near, began_[j])[limit] - before) / kDifference;
                    }
                    for (int k = 0; k < mover.count; ++k) {
                        right(mover.first + k) -= kStop * slope[k] * before;
                        for (int l = 0; l < mover.count; ++l)
                            matrix(mover.first + k, mover.first + l) += kStop * slope[k] * slope[l];
                    }
                }
            }
            if (!more) break;
        }
        for (const Mover& mover : movers_) {
            if (mover.place) continue;
            state.turn[mover.joint] = limited(mover.joint, state.turn[mover.joint]);
        }
        place(state);
        return state;
    }

    void descend() {
        Matrix hessian;
        Vector descent;
        double value = cost(now_);
        comeToRest(now_, value);
        for (int i = 0; i < options_.steps; ++i) {
            linearise(hessian, descent);
            bool better = false;
            double size = 0, gain = 0;
            for (int attempt = 0; attempt < 6 && !better; ++attempt) {
                const State next = step(hessian, descent, damping_, size);
                const double found = cost(next);
                better = found < value;
                if (better) {
                    gain = value - found;
                    const State before = now_;
                    now_ = next;
                    value = found;
                    comeToRest(before, value);
                    damping_ = std::max(damping_ * .2, 1e-7);
                } else {
                    damping_ = std::min(damping_ * 8, 1e2);
                }
            }
            if (!better || size < 1e-5 || gain < kLeastGain + 1e-7 * value) break;
        }
        damping_ = 1e-4;
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

    void bendStraightHinges() {
        for (const Mover& mover : movers_) {
            if (mover.count != 1) continue;
            glm::dquat& turn = now_.turn[mover.joint];
            const double flexion = bendOf(mover.joint, turn).flexion;
            if (flexion >= kFirstBend || flexion < kBentBackwards) continue;
            const double missing = kFirstBend - flexion;
            turn = limited(mover.joint, quaternionOf(missing * mover.axes[0]) * turn);
        }
        place(now_);
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

    const Skeleton& skeleton_;
    const IkOptions& options_;
    std::vector<IkTarget> targets_;
    std::vector<glm::dvec3> aims_;  // targets and what was added to them
    std::vector<Mover> movers_;
    std::vector<IkTarget> shakenPins_;
    std::array<glm::dquat, joint::kCount> began_, startTurn_;
    std::array<glm::dvec3, joint::kCount> beganRotation_;
    glm::dvec3 beganTrans_;
    State now_;
    int unknowns_ = 0;
    bool carried_ = false;  // the whole body goes where the pelvis is dragged
    double damping_ = 1e-4, ease_ = 1;
};

}  // namespace

IkTarget pinnedAt(const PosedSkeleton& posed, size_t joint) {
    CHECK(joint < joint::kCount, "joint {} is one of {}", joint, kJointCount);
    return {joint, posed.position[joint], 100, true, posed.rotation[joint]};
}

Pose solveIk(const Skeleton& skeleton, const Pose& start, std::span<const IkTarget> targets,
             const IkOptions& options) {
    const Pose& began = options.began ? *options.began : start;
    if (!isFinite(start) || !isFinite(began)) return start;
    for (const IkTarget& target : targets) {
        CHECK(target.joint < joint::kCount, "joint {} is one of {}", target.joint, kJointCount);
        if (!isFinite(target.position) || !(target.weight > 0) || !std::isfinite(target.weight))
            return start;
    }
    Solver solver(skeleton, start, began, targets, options);
    if (!solver.moves()) return start;
    solver.solve();
    return solver.result(start);
}

}  // namespace doppel
