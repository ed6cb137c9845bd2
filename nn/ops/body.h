// Linear blend skinning of SMPL's kind (Loper et al., "SMPL: A Skinned Multi-Person Linear Model",
// 2015): ten shape directions, 24 joints in a tree, axis-angle rotations.
//
//     shaped = template + shapeDirections * beta
//     rest   = regressor * shaped                          the joints of the unposed body
//     posed  = shaped + poseDirections * (R(theta) - I)    where the body has pose blend shapes
//     verts  = sum over joints of weight * G_j(theta, rest) * posed + trans
//     joints = origins of G_j + trans
#pragma once

#include <span>

#include "nn/body/body.h"
#include "nn/body/fingers.h"
#include "nn/core/graph.h"
#include "nn/core/rows.h"

namespace doppel {

// What a body's kernels read: constants of one graph.
struct LbsModel {
    int64_t vertexCount = 0;
    uint32_t influences = 0, entryChunks = 0;
    Tensor shapeDirections;                   // [V,3,10]
    Tensor poseDirections;                    // [V,3,207], or empty
    Tensor weights, weightJoints;             // [V,influences]
    Tensor entries, chunkBegin, jointChunks;  // the same by joint: see shaders/body/skin.comp
    Tensor regressor;                         // [n]
    Tensor jointBegin, jointVertices;         // [25], [n]
    Tensor vertexBegin, vertexEntries;        // [V+1], [n,2] the same by vertex
    Tensor parents;                           // [24]
};
// Keeps what is not zero of the weights and the regressor.
LbsModel lbsModel(Graph& graph, const BodyModel& body);

struct PosedBody {
    Tensor verts;   // [V,3] m
    Tensor joints;  // [24,3] m
};
// templateVerts [V,3], theta [72] or [24,3], beta [10], trans [3]. Gradients to these four, from
// verts and from joints; not to the model's constants.
PosedBody lbs(Graph& graph, const LbsModel& model, const Tensor& templateVerts, const Tensor& theta,
              const Tensor& beta, const Tensor& trans);

// The same in two steps, without gradients, for bodies that are posed again and again.
struct ShapedBody {
    Tensor verts;   // [V,3] before pose blend shapes
    Tensor joints;  // [24,3] of the unposed body
};
ShapedBody shapeBody(Graph& graph, const LbsModel& model, const Tensor& templateVerts,
                     const Tensor& beta);
// rows: those whose vertices are computed; the others keep theirs.
PosedBody poseBody(Graph& graph, const LbsModel& model, const ShapedBody& shaped,
                   const Tensor& theta, const Tensor& trans, const ListedRows& rows = {});

// y = R(rotation) (verts - pivot) + pivot + trans; verts [V,3], the others [3]. Gradients to all.
// With theta's first three numbers as rotation and the pelvis as pivot it brings a body posed
// without global orientation and translation to where theta and trans put it.
// With rows: these alone, and no gradient.
Tensor rigidTransform(Graph& graph, const Tensor& verts, const Tensor& rotation,
                      const Tensor& pivot, const Tensor& trans, const ListedRows& rows = {});

// What bendFingers()'s kernels read: constants of one graph.
struct FingerTensors {
    int64_t vertexCount = 0;
    Tensor turns, amounts;           // [F,4,7], [F,4]
    Tensor begin, fingers, entries;  // [V+1], [E], [E,5]
};
// Of a rig that is not empty.
FingerTensors fingerTensors(Graph& graph, const FingerRig& rig);

// verts [V,3] m with fingers bent by amounts [A] (nn/body/fingers.h, whose formula this is).
// Gradients to both.
Tensor bendFingers(Graph& graph, const Tensor& verts, const Tensor& amounts,
                   const FingerTensors& rig);

}  // namespace doppel
