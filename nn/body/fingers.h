// The fingers of a body model, which ends at the knuckles as SMPL does: found on its mesh, and how
// they bend. People let their hands hang half closed; a model's are flat and spread.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "nn/body/body.h"

namespace doppel {

// How far hands are from the model's own: {left curl, left close, right curl, right close}. With a
// curl of 1 the fingers bend by 62 degrees from knuckle to tip and the thumb goes before the palm,
// as of somebody at ease; with a close of 1 fingers lie side by side, the thumb along them.
using HandAmounts = std::array<float, 4>;

// A vertex v that fingers f move by weights w_f goes to v + sum w_f (B_f v - v), where B_f turns
// about four fixed axes one after another: the joint next to the tip, the middle one, the knuckle,
// and the knuckle once more, sideways. The thumb's are the same of its own.
struct FingerRig {
    static constexpr int64_t kTurns = 4, kTurnNumbers = 7, kEntryNumbers = 1 + kTurns;
    // [F,kTurns,7] pivot (m), axis (of length 1), angle (rad) for an amount of 1.
    std::vector<float> turns;
    std::vector<int32_t> amounts;  // [F,kTurns] which of HandAmounts
    // Of each vertex its entries begin[v] to begin[v+1]: a finger, w, and what part of each turn it
    // makes, for skin at a joint makes some of it.
    std::vector<int32_t> begin;    // [V+1]
    std::vector<int32_t> fingers;  // [E]
    std::vector<float> entries;    // [E,1+kTurns]

    bool empty() const { return fingers.empty(); }
};

// Of the body at rest, offsets added. Empty where a hand has not five fingers that stand off by
// 15 mm (mittens), or is not of one piece with the forearm.
FingerRig fingerRig(const BodyModel& body);

// verts [V,3] m, bent: what bendFingers() (nn/ops/body.h) computes.
std::vector<float> bentFingers(const FingerRig& rig, std::span<const float> verts,
                               const HandAmounts& amounts);

}  // namespace doppel
