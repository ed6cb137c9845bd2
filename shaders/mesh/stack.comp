// Both weights of a graph convolution as one matrix: wide [2H,O] = [W0, b0, zeros | W1, b1,
// zeros]^T, the right side of mesh/graph_panels.comp's product, and weight [2O,row] = W0 above W1
// with zeros behind, for the gradients; backward takes the gradient of weight apart again.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "common/op.glsl"
#include "mesh/params.h"
PARAMS(StackParams, 12)
BUFFER(0, readonly, float, weight0);    // [O,I]
BUFFER(1, readonly, float, bias0);      // [O]
BUFFER(2, readonly, float, weight1);    // [O,I]
BUFFER(3, readonly, float, bias1);      // [O]
BUFFER(4, writeonly, float, weight);    // [2O,row] one above the other, zeros behind
BUFFER(5, writeonly, float, wide);      // [2H,O] side by side, transposed; see graph_panels.comp
BUFFER(6, readonly, float, dweight);    // [2O,row]
BUFFER(7, readonly, float, dbias);      // [2O]
BUFFER(8, writeonly, float, dweight0);  // [O,I]
BUFFER(9, writeonly, float, dbias0);    // [O]
BUFFER(10, writeonly, float, dweight1); // [O,I]
BUFFER(11, writeonly, float, dbias1);   // [O]

ENTRY(side_by_side) {
    uint i = linearIndex(), H = params.halfColumns;
    if (i >= 2 * params.outputs * H) return;
    uint column = quotient(i, params.by), feature = remainder(i, column, params.by);
    bool second = column >= H;
    if (second) column -= H;
    float value = 0;
    if (column < params.inputs) {
        uint at = feature * params.inputs + column;
        value = second ? weight1.d[at] : weight0.d[at];
    } else if (column == params.inputs) {
        value = second ? bias1.d[feature] : bias0.d[feature];
    }
    wide.d[i] = value;
}

ENTRY(forward) {
    uint i = linearIndex();
    if (i >= 2 * params.outputs * params.row) return;
    uint feature = quotient(i, params.by), column = remainder(i, feature, params.by);
    bool second = feature >= params.outputs;
    if (second) feature -= params.outputs;
    uint at = feature * params.inputs + column;
    float value = 0;
    if (column < params.inputs) value = second ? weight1.d[at] : weight0.d[at];
    weight.d[i] = value;
}

ENTRY(backward) {
    uint i = linearIndex();
    if (i >= params.outputs * params.inputs) return;
    uint feature = quotient(i, params.by), column = remainder(i, feature, params.by);
    uint second = feature + params.outputs;
    dweight0.d[i] = dweight.d[feature * params.row + column];
    dweight1.d[i] = dweight.d[second * params.row + column];
    if (column > 0) return;
    dbias0.d[feature] = dbias.d[feature];
    dbias1.d[feature] = dbias.d[second];
}
