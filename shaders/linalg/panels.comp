#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "linalg/params.h"
PARAMS(PanelsParams, 2)
BUFFER(0, readonly, float, matrix);   // see the strides
BUFFER(1, writeonly, float, packed);  // [batch, panels, stepsInPanel, kWidth]

layout(constant_id = 1) const uint kWidth = 32;  // a power of two

// Workgroups: x steps and items of a panel, y panels, z matrices of the batch.
ENTRY(pack) {
    uint i = gl_WorkGroupID.x * gl_WorkGroupSize.x + gl_LocalInvocationID.x;
    uint step = i / kWidth, item = gl_WorkGroupID.y * kWidth + i % kWidth;
    uint stepsInPanel = params.stepsInPanel;
    if (step >= stepsInPanel) return;
    bool inside = step < params.steps && item < params.count;
    uint at = params.start + gl_WorkGroupID.z * params.strideMatrix;
    if (inside) at += item * params.strideItem + step * params.strideStep;
    float v = matrix.d[at];
    uint panel = gl_WorkGroupID.z * params.panels + gl_WorkGroupID.y;
    packed.d[panel * stepsInPanel * kWidth + i] = inside ? v : 0;
}
