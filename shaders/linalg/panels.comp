// packed[panel, step, within] = matrix[panel kWidth + within, step]: packs a matrix [count, steps],
// by its strides, into the panels that a product reads
// (common/panels.h): in single precision, or rounded to halves and then, where they are gradients,
// multiplied by halfScale(). Behind the last item and the last step there are zeros.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "common/loads.glsl"
#include "common/panels.h"
#include "linalg/params.h"
#include "linalg/half_scale.glsl"
PARAMS(PanelsParams, 5)
BUFFER(0, readonly, float, matrix);  // see the strides
BUFFER(1, readonly, vec2, pairs);    // the same, in pairs
BUFFER(2, writeonly, vec2, packed);  // [batch, panels, stepsInPanel, kWidth], in pairs
BUFFER(3, writeonly, uint, halves);  // the same, where kHalves
BUFFER(4, readonly, uint, largest);  // [1], where kScaled

layout(constant_id = 1) const uint kWidth = 32;  // a power of two
// Which neighbours in memory start at even elements and can be loaded together.
layout(constant_id = 2) const uint kPairs = 0;  // 0: none, 1: items, 2: steps

layout(constant_id = 3) const bool kHalves = false;
layout(constant_id = 4) const bool kScaled = false;  // times halfScale(largest)
layout(constant_id = 5) const bool kInterleaved = false;  // see kLayoutInterleaved

const uint kSteps = 4;  // of an invocation, by two items

// What a half cannot hold becomes its largest number; infinities and NaN stay, to be seen.
vec2 bounded(vec2 v) {
    const float kMost = 65504;
    return vec2(abs(v.x) > kMost && !isinf(v.x) ? sign(v.x) * kMost : v.x,
                abs(v.y) > kMost && !isinf(v.y) ? sign(v.y) * kMost : v.y);
}

// Workgroups: x steps and items of a panel, y panels, z matrices of the batch.
ENTRY(pack) {
    uint i = gl_WorkGroupID.x * gl_WorkGroupSize.x + localIndex();
    uint step = i / (kWidth / 2) * kSteps, within = i % (kWidth / 2) * 2;
    uint item = gl_WorkGroupID.y * kWidth + within;
    uint stepsInPanel = params.stepsInPanel, steps = params.steps, count = params.count;
    if (step >= stepsInPanel) return;
    uint strideItem = params.strideItem, strideStep = params.strideStep;
    uint first = gl_WorkGroupID.y * kWidth;  // item of this panel
    uint start = params.start + gl_WorkGroupID.z * params.strideMatrix +
                 gl_WorkGroupID.y * params.stridePanel;
    // Beyond the end the last element is read, and a zero written.
    uint left = start + (min(item, count - 1) - first) * strideItem;
    uint right = start + (min(item + 1, count - 1) - first) * strideItem;
    bvec2 items = bvec2(item < count, item + 1 < count);
    vec2 v[kSteps];
    if (kPairs == 2) {
        [[unroll]] for (uint s = 0; s < kSteps; s += 2) {
            uint at = min(step + s, steps - 2);
            vec2 a = pairs.d[(left + at) / 2];
            vec2 b = pairs.d[(right + at) / 2];
            v[s] = vec2(a.x, b.x);
            v[s + 1] = vec2(a.y, b.y);
        }
    } else {
        [[unroll]] for (uint s = 0; s < kSteps; ++s) {
            uint at = min(step + s, steps - 1) * strideStep;
            if (kPairs == 1)
                v[s] = pairs.d[(start + min(item, count - 2) - first + at) / 2];
            else
                v[s] = vec2(matrix.d[left + at], matrix.d[right + at]);
        }
    }
    float scale = 1;
    if (kScaled) scale = halfScale(largest.d[0]);
    uint panel = gl_WorkGroupID.z * params.panels + gl_WorkGroupID.y;
    [[unroll]] for (uint s = 0; s < kSteps; ++s) {
        if (step + s < stepsInPanel) {
            vec2 inside = mix(vec2(0), v[s], items);
            uint before = panel * stepsInPanel + step;
            uint at = kInterleaved
                          ? placeInPanel(2 * within + s % 2 * 2, before + s / 2 * 2, kWidth)
                          : placeInPanel(within, before + s, kWidth);
            vec2 value = step + s < steps ? inside : vec2(0);
            if (kHalves) {
                if (kScaled) value *= scale;
                halves.d[at / 2] = packHalf2x16(bounded(value));
            } else {
                packed.d[at / 2] = value;
            }
        }
    }
}
