// Fingers bend: a vertex v that fingers f move by weights w_f goes to
//     y = v + sum_f w_f (B_f v - v),    B_f = T_3 T_2 T_1 T_0,
// T_j turning about a fixed axis through a fixed pivot by angle_j share_j amount_j, the share being the
// vertex's own and the amount one that all of a hand has (nn/body/fingers.h). Going back along the
// turns, with g the gradient behind turn j and q the place there,
//     damount_j += g . (axis x (q - pivot)) angle_j share_j,    g <- T_j^T g.
// verts [V,3], metres, amounts [A]. A vertex has its terms of damount in a row of its own.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "body/params.h"
#include "body/rotation.glsl"
PARAMS(BendFingersParams, 11)
BUFFER(0, readonly, vec3, verts);     // [V,3]
BUFFER(1, readonly, float, amounts);  // [A]
BUFFER(2, readonly, float, turns);    // [F,kTurns,7] pivot, axis, angle
BUFFER(3, readonly, int, turnAmount); // [F,kTurns] of which amount
BUFFER(4, readonly, int, begin);      // [V+1]
BUFFER(5, readonly, int, fingers);    // [E]
BUFFER(6, readonly, float, entries);  // [E,1+kTurns] w, shares
BUFFER(7, writeonly, vec3, y);        // [V,3]
BUFFER(8, readonly, vec3, dy);        // [V,3]
BUFFER(9, writeonly, vec3, dverts);   // [V,3]
BUFFER(10, readwrite, float, terms);  // [V,A]

struct Turn {
    vec3 pivot, axis;
    float rate;  // of the angle, by the amount
    int amount;
};

Turn turnOf(int entry, int j) {
    int t = kFingerTurns * fingers.d[entry] + j, at = 7 * t;
    return Turn(vec3(turns.d[at], turns.d[at + 1], turns.d[at + 2]),
                vec3(turns.d[at + 3], turns.d[at + 4], turns.d[at + 5]),
                turns.d[at + 6] * entries.d[(1 + kFingerTurns) * entry + 1 + j], turnAmount.d[t]);
}

vec3 turned(vec3 r, vec3 axis, float angle) {
    vec2 s = sinCos(angle);
    return s.y * r + s.x * cross(axis, r) + (1 - s.y) * dot(axis, r) * axis;
}

ENTRY(forward) {
    uint v = linearIndex();
    if (v >= params.vertices) return;
    vec3 p = verts.d[v], sum = p;
    for (int e = begin.d[v]; e < begin.d[v + 1]; ++e) {
        vec3 q = p;
        for (int j = 0; j < kFingerTurns; ++j) {
            Turn t = turnOf(e, j);
            q = t.pivot + turned(q - t.pivot, t.axis, t.rate * amounts.d[t.amount]);
        }
        sum += entries.d[(1 + kFingerTurns) * e] * (q - p);
    }
    y.d[v] = sum;
}

ENTRY(backward) {
    uint v = linearIndex();
    if (v >= params.vertices) return;
    vec3 p = verts.d[v], d = dy.d[v], sum = d;
    for (uint a = 0; a < params.amounts; ++a) terms.d[params.amounts * v + a] = 0;
    for (int e = begin.d[v]; e < begin.d[v + 1]; ++e) {
        vec3 q = p, g = entries.d[(1 + kFingerTurns) * e] * d;
        sum -= g;
        for (int j = 0; j < kFingerTurns; ++j) {
            Turn t = turnOf(e, j);
            q = t.pivot + turned(q - t.pivot, t.axis, t.rate * amounts.d[t.amount]);
        }
        for (int j = kFingerTurns - 1; j >= 0; --j) {
            Turn t = turnOf(e, j);
            float angle = t.rate * amounts.d[t.amount];
            vec3 r = q - t.pivot;
            terms.d[params.amounts * v + t.amount] += dot(g, cross(t.axis, r)) * t.rate;
            q = t.pivot + turned(r, t.axis, -angle);
            g = turned(g, t.axis, -angle);
        }
        sum += g;
    }
    dverts.d[v] = sum;
}
