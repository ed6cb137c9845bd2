// What inverse kinematics minimises: distances of targets, turns of joints, limits, balance; with
// its derivatives.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <vector>

#include "viewer/pose/balance.h"
#include "viewer/pose/ik_target.h"
#include "viewer/pose/skeleton.h"

namespace doppel {

// Resistance to a turn, m² per rad²: what a turn by one radian costs in squared distance from the
// target. The ratios make the feel, a hand being moved by shoulder and elbow and the trunk
// following only where these have no more to give; the size keeps targets within a centimetre
// before the rounds of solve() close the rest.
inline double resistanceOf(size_t joint) {
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
inline bool sticks(size_t joint) {
    return joint == joint::kSpine1 || joint == joint::kSpine2 || joint == joint::kSpine3 ||
           joint == joint::kPelvis;
}

// The pelvis's place, m² per m²: dragged itself, and giving way above pinned legs.
constexpr double kDraggedPlace = 1e-6, kGivingPlace = .5;

// Beyond this distance, metres, the pull of a target grows no more (Huber's loss): a cursor far
// away stretches the body towards it as one just out of reach does.
constexpr double kFarthestPull = .25;
// What a radian beyond a limit costs, m² per rad². It is never reached: what is left beyond is cut
// off in the end, some hundred-thousandths of a radian.
constexpr double kStop = 1e3;

// What slips first goes so far, radians or metres.
constexpr double kFirstSlip = .01;

// Square metres that a square metre out of balance counts.
constexpr double kBalance = 40;

constexpr int kMostUnknowns = 3 + static_cast<int>(kThetaSize);
using Matrix =
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMostUnknowns, kMostUnknowns>;
using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMostUnknowns, 1>;
using Jacobian = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMostUnknowns>;

inline glm::dvec3 shortened(const glm::dvec3& v, double length) {
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

// The terms of one drag, and the state that a search is in.
class IkProblem {
protected:
    IkProblem(const Skeleton& skeleton, const Pose& began, std::span<const IkTarget> targets,
              const IkOptions& options)
        : skeleton_(skeleton), options_(options), targets_(targets.begin(), targets.end()) {
        for (size_t j = 0; j < joint::kCount; ++j) {
            began_[j] = quaternionOf(began.rotation[j]);
            now_.turn[j] = began_[j];
        }
        beganTrans_ = began.trans;
        now_.trans = began.trans;
        findMovers();
        place(now_);
        findSupport(began);
        for (IkTarget& target : targets_) {
            if (!target.pinned && !carried_)
                target.position = withinSight(target, skeleton.rest[0] + began.trans);
        }
    }

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
        leans_ = pelvisMoves && !pelvisDragged;
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
            // Above pinned feet all of the body gives way from the first.
            const double sticking = leans_      ? 0
                                    : place     ? kStickingPlace
                                    : sticks(j) ? kStickingTurn
                                                : 0;
            Mover mover{j, place, unknowns_, 3, resistance, sticking, {}};
            mover.axes = {glm::dvec3(1, 0, 0), glm::dvec3(0, 1, 0), glm::dvec3(0, 0, 1)};
            if (!place && isHinge(j)) {
                // Bent sideways by a capture, a hinge goes on in the plane that it is bent in; a
                // straight one in the human way.
                const Bend bend = bendOf(j, began_[j]);
                constexpr double kClear = 1;
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

    // What the centre of mass stays over, once something moves the body above pinned feet.
    void findSupport(const Pose& began) {
        if (!options_.balance || !leans_) return;
        const PosedSkeleton posed = forwardKinematics(skeleton_, began);
        for (const IkTarget& target : targets_)
            if (target.pinned && (skeleton_.hangsOn(target.joint, joint::kLeftKnee) ||
                                  skeleton_.hangsOn(target.joint, joint::kRightKnee)))
                addFoot(posed, target.joint, target.position - posed.position[target.joint],
                        support_);
        // Whoever leant out before may go on to, so that nothing jumps when it is touched.
        if (!support_.empty()) support_.push_back(fromAbove(centreOfMass(posed)));
    }

    glm::dvec3 massCentre(const State& state) const {
        glm::dvec3 sum(0);
        for (size_t j = 0; j < joint::kCount; ++j) sum += jointMasses()[j] * state.position[j];
        return sum;
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
    // How far a mover is from where the drag began, in its parent's frame.
    glm::dvec3 away(const Mover& mover, const State& state) const {
        if (mover.place) return state.trans - beganTrans_;
        if (state.turn[mover.joint] == began_[mover.joint]) return glm::dvec3(0);  // exactly
        return axisAngleOf(state.turn[mover.joint] * glm::conjugate(began_[mover.joint]));
    }

    double cost(const State& state) const {
        double sum = 0;
        for (size_t t = 0; t < targets_.size(); ++t) {
            const double far =
                glm::length(targets_[t].position - state.position[targets_[t].joint]);
            sum += targets_[t].weight * (far < kFarthestPull || targets_[t].pinned
                                             ? far * far
                                             : kFarthestPull * (2 * far - kFarthestPull));
        }
        for (const Mover& mover : movers_) {
            const glm::dvec3 d = away(mover, state);
            sum +=
                ease_ * mover.resistance * (glm::dot(d, d) + 2 * mover.sticking * glm::length(d));
        }
        if (options_.limits)
            for (const Mover& mover : movers_) {
                if (mover.place || mover.joint == joint::kPelvis) continue;
                for (double by :
                     beyondLimits(mover.joint, state.turn[mover.joint], began_[mover.joint]))
                    if (by > 0) sum += kStop * by * by;
            }
        if (!support_.empty()) {
            const glm::dvec2 out = wayOut(fromAbove(massCentre(state)), support_);
            sum += kBalance * glm::dot(out, out);
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

    // Half of the cost's second derivatives and of its gradient. Those of a target's distance are
    // whole, as Newton takes them: out of reach, where the distance stays, Gauss and Newton's share
    // of them is so small that a search by it swings to and fro.
    void linearise(Matrix& hessian, Vector& descent) const {
        hessian.setZero(unknowns_, unknowns_);
        descent.setZero(unknowns_);
        Jacobian jacobian;
        for (size_t t = 0; t < targets_.size(); ++t) {
            const size_t joint = targets_[t].joint;
            const glm::dvec3 error = targets_[t].position - now_.position[joint];
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
            const Eigen::Vector3d pull(error.x, error.y, error.z);
            if (!targets_[t].pinned && far > kFarthestPull) {
                // Of the distance itself: along the pull it has no curve.
                const Vector along = jacobian.transpose() * (pull / far);
                hessian.noalias() -= weight * along * along.transpose();
            }
            hessian.noalias() += weight * jacobian.transpose() * jacobian;
            descent.noalias() += weight * jacobian.transpose() * pull;
            addCurves(hessian, jacobian, joint, weight * error);
        }
        if (options_.limits) addLimits(hessian, descent);
        if (!support_.empty()) addBalance(hessian, descent);
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

    // The curves on which a joint moves when those above it turn: minus pull · d²p. Of two axes the
    // one nearer to the pelvis turns the way that the other one leads to; of two of one joint, the
    // mean of both orders.
    void addCurves(Matrix& hessian, const Jacobian& jacobian, size_t joint,
                   const glm::dvec3& pull) const {
        const auto column = [&](int i) {
            return glm::dvec3(jacobian(0, i), jacobian(1, i), jacobian(2, i));
        };
        for (const Mover& a : movers_) {
            if (a.place || !skeleton_.hangsOn(joint, a.joint) || joint == a.joint) continue;
            for (const Mover& b : movers_) {
                if (b.place || b.joint < a.joint || !skeleton_.hangsOn(joint, b.joint)) continue;
                for (int k = 0; k < a.count; ++k) {
                    // pull · (a × c) = c · (pull × a)
                    const glm::dvec3 across = glm::cross(pull, worldAxis(a, k));
                    for (int l = 0; l < b.count; ++l) {
                        const double curve = glm::dot(across, column(b.first + l));
                        hessian(a.first + k, b.first + l) -= a.joint == b.joint ? curve / 2 : curve;
                        hessian(b.first + l, a.first + k) -= a.joint == b.joint ? curve / 2 : curve;
                    }
                }
            }
        }
    }

    // How a limit grows with the unknowns of its joint.
    Eigen::Vector3d limitSlope(const Mover& mover, size_t limit, double now) const {
        constexpr double kDifference = 1e-6;
        Eigen::Vector3d slope(0, 0, 0);
        for (int k = 0; k < mover.count; ++k) {
            const glm::dquat near = quaternionOf(kDifference * mover.axes[static_cast<size_t>(k)]) *
                                    now_.turn[mover.joint];
            slope[k] =
                (beyondLimits(mover.joint, near, began_[mover.joint])[limit] - now) / kDifference;
        }
        return slope;
    }

    void addLimit(Matrix& hessian, Vector& descent, const Mover& mover, size_t limit,
                  double now) const {
        const Eigen::Vector3d slope = limitSlope(mover, limit, now);
        for (int k = 0; k < mover.count; ++k) {
            descent(mover.first + k) -= kStop * slope[k] * now;
            for (int l = 0; l < mover.count; ++l)
                hessian(mover.first + k, mover.first + l) += kStop * slope[k] * slope[l];
        }
    }

    void addLimits(Matrix& hessian, Vector& descent) const {
        for (const Mover& mover : movers_) {
            if (mover.place || mover.joint == joint::kPelvis) continue;
            const auto now = beyondLimits(mover.joint, now_.turn[mover.joint], began_[mover.joint]);
            for (size_t limit = 0; limit < now.size(); ++limit)
                if (now[limit] > 0) addLimit(hessian, descent, mover, limit, now[limit]);
        }
    }

    void addBalance(Matrix& hessian, Vector& descent) const {
        const glm::dvec2 out = wayOut(fromAbove(massCentre(now_)), support_);
        const double far = glm::length(out);
        if (far < 1e-9) return;
        const glm::dvec3 away(out.x / far, 0, out.y / far);
        Vector slope = Vector::Zero(unknowns_);
        for (const Mover& mover : movers_) {
            // The mass that hangs on it, times the way to its centre.
            glm::dvec3 arm(0);
            for (size_t j = mover.joint; j < joint::kCount; ++j)
                if (skeleton_.hangsOn(j, mover.joint))
                    arm += jointMasses()[j] * (now_.position[j] - now_.position[mover.joint]);
            for (int k = 0; k < mover.count; ++k) {
                const glm::dvec3 axis = worldAxis(mover, k);
                slope(mover.first + k) = glm::dot(away, mover.place ? axis : glm::cross(axis, arm));
            }
        }
        hessian.noalias() += kBalance * slope * slope.transpose();
        descent.noalias() -= kBalance * far * slope;
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

    const Skeleton& skeleton_;
    const IkOptions& options_;
    std::vector<IkTarget> targets_;
    std::vector<Mover> movers_;
    std::vector<IkTarget> shakenPins_;
    std::array<glm::dquat, joint::kCount> began_;
    glm::dvec3 beganTrans_;
    State now_;
    int unknowns_ = 0;
    std::vector<glm::dvec2> support_;  // seen from above; empty: no balance
    bool leans_ = false;               // the body above pinned feet follows what is dragged
    bool carried_ = false;             // the whole body goes where the pelvis is dragged
    double ease_ = 1;
};

}  // namespace doppel
