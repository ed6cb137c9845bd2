// A frame's pose from where its fit starts and a learnt correction: theta = start[:72] + c[:72]
// (axis-angle, radians), trans = start[72:] + transScale c[72:] (m). transScale lets one learning
// rate serve both.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "fit/params.h"
PARAMS(PoseCorrectionParams, 7)
BUFFER(0, readonly, float, start);         // [75]
BUFFER(1, readonly, float, correction);    // [75]
BUFFER(2, writeonly, float, theta);        // [72]
BUFFER(3, writeonly, float, trans);        // [3]
BUFFER(4, readonly, float, dtheta);        // [72]
BUFFER(5, readonly, float, dtrans);        // [3]
BUFFER(6, writeonly, float, dcorrection);  // [75]

ENTRY(forward) {
    uint i = linearIndex();
    if (i < 72)
        theta.d[i] = start.d[i] + correction.d[i];
    else if (i < POSE_ROW_LENGTH)
        trans.d[i - 72] = start.d[i] + params.transScale * correction.d[i];
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i < 72)
        dcorrection.d[i] = dtheta.d[i];
    else if (i < POSE_ROW_LENGTH)
        dcorrection.d[i] = params.transScale * dtrans.d[i - 72];
}
