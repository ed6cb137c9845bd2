// Where the interface's items are.
//
// Each widget takes down where it was drawn and whether anything of it was cut, so that tests press
// what a user presses, and know that all of it can be read.
#pragma once

#include <glm/glm.hpp>
#include <string>
#include <vector>

namespace doppel {

struct DrawnItem {
    std::string label;
    glm::vec2 low, high;  // window coordinates
    bool cut = false;     // it does not fit into its window, or its words not into it
};

// Those of the frame that is being drawn, or was drawn last.
const std::vector<DrawnItem>& drawnItems();
void forgetItems();

// Whether the mouse rests on an item whose tip is still to come.
bool tipPending();

}  // namespace doppel
