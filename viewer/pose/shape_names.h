// What each shape coefficient does to the body, measured.
#pragma once

#include <array>
#include <span>
#include <string>

#include "nn/body/body.h"

namespace doppel {

// Of the rest pose, metres.
struct ShapeMeasures {
    double height = 0;
    double girth = 0;      // of a cylinder of the body's height and volume
    double legs = 0;       // hip to knee to ankle, mean of both sides
    double arms = 0;       // shoulder to elbow to wrist, likewise
    double shoulders = 0;  // between the joints
    double hips = 0;       // likewise
};
// beta [10]
ShapeMeasures measured(const BodyModel& body, std::span<const double> beta);

struct ShapeName {
    // What changes most for its size as the coefficient grows, "shorter arms, longer legs": height,
    // and what of the others grows or shrinks more than it; a second one where it changes half as
    // much. "fine form" where nothing changes by 0.3 %.
    std::string name;
    std::string effect;  // all measures, "height +5.1 cm, girth -0.4 cm, ..." for one unit
};
// About the mean shape.
std::array<ShapeName, BodyModel::kShapes> shapeNames(const BodyModel& body);

}  // namespace doppel
