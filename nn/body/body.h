// A body model in SMPL's terms: a template mesh with shape directions, 24 joints and skinning
// weights, and what the method needs beside it: an atlas, part labels, face and soles.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "engine/files/npz.h"
#include "nn/body/joint.h"
#include "nn/core/sparse.h"

namespace doppel {

// Points on a surface: each a mean of the corners of a face.
struct SurfacePoints {
    std::vector<int32_t> corners;  // [P,3] vertices
    std::vector<float> weights;    // [P,3] each row sums to one
    std::vector<float> trust;      // [P] 0 to 1: how surely it is the same place on everybody
    bool empty() const { return corners.empty(); }
};
// [P,V]: what the points are of a body's vertices.
SparseMatrix matrixOf(const SurfacePoints& points, int64_t vertexCount);

// Rest pose: metres, y up, x to the body's left, z forward. C order.
struct BodyModel {
    static constexpr int kJoints = kJointCount, kShapes = 10, kPoseFeatures = 9 * (kJoints - 1);

    std::string file;  // for errors
    int64_t vertexCount = 0, faceCount = 0, uvCount = 0;
    std::vector<float> templateVertices;  // [V,3]
    std::vector<float> offsets;           // [V,3] a person's own shape beyond it; empty: none
    std::vector<int32_t> faces;           // [F,3] counter-clockwise from outside
    std::vector<float> shapeDirections;   // [V,3,10] m per standard deviation
    std::vector<float> poseDirections;    // [V,3,207] of R - I of joints 1 to 23; empty: none
    std::vector<float> weights;           // [V,24] each row sums to one
    std::vector<float> jointRegressor;    // [24,V] each row sums to one
    std::vector<int32_t> parents;         // [24] -1 for the first, else less than the joint
    std::vector<float> uvs;               // [T,2] glTF's: (0,0) is the texture's top left corner
    std::vector<int32_t> uvFaces;         // [F,3] into uvs, corner by corner as faces
    std::vector<uint8_t> part;            // [V] BodyPart
    std::vector<uint8_t> face, sole;      // [V] 1 inside
    SurfacePoints facePoints;             // kFacePoints, or empty: nobody knows where they are
    // Those of the model itself, which are the first; what follows is a person's cap
    // (nn/body/body_caps.h).
    int64_t modelVertices = 0, modelFaces = 0, modelUvs = 0;
    int64_t capVertices() const { return vertexCount - modelVertices; }

    // [V,3] templateVertices + offsets: what is shaped, posed and drawn. Joints follow, for they
    // are regressed from it.
    std::vector<float> restVertices() const;
};

// From the arrays of our body files (assets/body) or of SMPL's:
//
//     v_template [V,3]  f [F,3]  shapedirs [V,3,10 or more; the first ten count]
//     weights [V,24]  J_regressor [24,V]  kintree_table [2,24] (row 0: parents)
//     posedirs [V,3,207]                          optional
//     vt [T,2] and ft [F,3]                       optional: an atlas is made (see body_atlas.h)
//     part [V], face_mask [V], sole_mask [V]      optional: from weights and template
//     face_points [468,3], face_point_weights [468,3], face_point_trust [468]
//                                                 optional, together: facePoints
//     offsets [V,3]                               optional: a person's, from training
//     model_size [3]                              optional: how many of the vertices, faces and
//                                                 rows of vt are the model's; the rest is a cap
//
// Other arrays are left alone. Everything is checked; what is wrong is an InputError that names
// the file, the array, what was expected and what was found.
BodyModel bodyFromNpz(const Npz& arrays);

// parents [24]: a tree in which every joint comes after its parent, the first having none (any
// negative number). InputError naming `where` otherwise.
void checkParents(std::span<const int32_t> parents, std::string_view where);

// [24,3] Joints in rest pose, and [V,3] shaped vertices, for beta [10].
std::vector<double> shapedVertices(const BodyModel& body, std::span<const double> beta);
std::vector<double> restJoints(const BodyModel& body, std::span<const double> beta);

// The method's K(v): how far one block of the mesh refinement may move a vertex along each axis,
// metres [V]. Zero on the face, the soles and the hands.
enum class ClampBounds {
    Paper,    // as the paper's table has it
    Program,  // as its authors' program has it: upper arms and forearms the other way round
    None,     // 1 m, which an offset (a tanh) does not reach
};
std::vector<float> clampBounds(const BodyModel& body, ClampBounds source);

// How much of each vertex [V] hangs on the bones of a hand: 0 to 1, less towards the forearms.
std::vector<float> handShares(const BodyModel& body);

// How much of each vertex [V] is the face's: 1 on it, and less and less over some rings around it.
std::vector<float> faceShares(const BodyModel& body);

// How stiff the surface is [V]: 1, `hands` where a vertex is a hand's, and `face` on the face. A
// finger is three pixels wide where a person fills a frame, so outlines alone make gloves of hands;
// and colours make creases of a face that each frame's pose has elsewhere.
std::vector<float> surfaceStiffness(const BodyModel& body, double hands, double face);

}  // namespace doppel
