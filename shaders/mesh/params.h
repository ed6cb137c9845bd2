#ifndef MESH_PARAMS_H
#define MESH_PARAMS_H
#include "common/divide.h"
#include "common/constants.h"
SHARED_BEGIN
struct MeshParams {
    uint n;       // vertices, or faces
    float scale;  // of a loss: one over the number of its terms
};
struct AggregateParams {
    uint vertices;
    uint outputs;   // O, features of a vertex
    uint xRow;      // numbers from one row of z or x to the next
    uint row;       // of y
    Divisor byRow;  // invocations of a vertex, where there are several
};
struct StackParams {
    uint outputs, inputs;  // O, I
    uint row;              // inputs and the columns of zeros behind them
    uint halfColumns;      // H; see graph_panels.comp
    Divisor by;            // what a dispatch's invocations are divided by
};
struct GraphPanelsParams {
    uint vertices;
    uint inputs;       // I, numbers of a vertex that count
    uint row;          // numbers from one row of x to the next, I or more
    uint halfColumns;  // H: columns for the vertex itself, and as many for its neighbours
    Divisor byPieces;  // invocations of a vertex
};
struct OffsetPenaltyParams {
    uint vertices;
    float scale, stay, smoothness;
};
struct FoldPenaltyParams {
    uint faces;
    float least;
};
struct SmoothSolveParams {
    uint vertices;
    float lambda;
    float ofStep, ofResidual;  // the iteration's coefficients
};
SHARED_CONSTANT float kNormalEpsilon = 1e-6f;  // m^2; see vertexNormals()
SHARED_END
#endif
