// The gradient of body/pose.comp, where the formulas are: from those of the transforms, the joints
// and the features R - I to those of theta [24,3] (radians), the rest joints and trans (m). Per joint
//     dR_j = world_p^T d(world_j),    dr_j = world_p^T d(origin_j),
// and a joint's frame gathers from its children: from the tips to the root, by one invocation.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "body/params.h"
#include "body/rotation.glsl"
PARAMS(BodyParams, 12)
BUFFER(0, readonly, vec3, theta);         // [24,3]
BUFFER(1, readonly, vec3, rest);          // [24,3]
BUFFER(2, readonly, int, parents);        // [24]
BUFFER(3, readonly, vec4, world);         // [24,3,4]
BUFFER(4, readonly, vec4, dtransforms);   // [24,3,4]
BUFFER(5, readonly, vec3, djoints);       // [24,3]
BUFFER(6, readonly, vec3, dvertsSum);     // [3] dverts, summed over the vertices
BUFFER(7, readonly, float, dfeatures);    // [23,3,3]
BUFFER(8, readwrite, vec4, dworld);       // [24,3,4] scratch
BUFFER(9, writeonly, vec3, dtheta);       // [24,3]
BUFFER(10, readwrite, vec3, drest);       // [24,3]
BUFFER(11, writeonly, vec3, dtrans);      // [3]

ENTRY(backward) {
    if (linearIndex() > 0) return;
    vec3 shift = dvertsSum.d[0];
    for (int j = 0; j < 24; ++j) {
        // transforms = [R | origin - R rest], joints = origin + trans
        vec3 doffset = LOAD_ORIGIN(dtransforms, j), djoint = djoints.d[j];
        mat3 R = LOAD_ROTATION(world, j);
        mat3 dR = LOAD_ROTATION(dtransforms, j) - outerProduct(doffset, rest.d[j]);
        vec3 dorigin = doffset + djoint;
        drest.d[j] = -(doffset * R);
        STORE_TRANSFORM(dworld, j, dR, dorigin)
        shift += djoint;
    }
    for (int j = 23; j > 0; --j) {
        // R = parent * local, origin = parent * (rest - restOfParent) + originOfParent
        int p = parents.d[j];
        mat3 parent = LOAD_ROTATION(world, p), dR = LOAD_ROTATION(dworld, j);
        vec3 dorigin = LOAD_ORIGIN(dworld, j), bone = rest.d[j] - rest.d[p];
        mat3 dlocal = transpose(parent) * dR;
        for (int row = 0; row < 3; ++row)
            for (int column = 0; column < 3; ++column)
                dlocal[column][row] += dfeatures.d[(j - 1) * 9 + row * 3 + column];
        vec3 w = theta.d[j];
        dtheta.d[j] = rotationGradient(w, dlocal);
        mat3 dparent = LOAD_ROTATION(dworld, p) + dR * transpose(rotationOf(w)) +
                       outerProduct(dorigin, bone);
        vec3 dparentOrigin = LOAD_ORIGIN(dworld, p) + dorigin;
        STORE_TRANSFORM(dworld, p, dparent, dparentOrigin)
        vec3 dbone = dorigin * parent;
        drest.d[j] += dbone;
        drest.d[p] -= dbone;
    }
    dtheta.d[0] = rotationGradient(theta.d[0], LOAD_ROTATION(dworld, 0));
    drest.d[0] += LOAD_ORIGIN(dworld, 0);
    dtrans.d[0] = shift;
}
