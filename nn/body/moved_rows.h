// Which vertices of a body a new pose moves, and how far along the mesh that reaches.
//
// Skinning moves those that hang on a joint that turned, or on a joint behind it, and leaves all
// others as they are to the last bit. What is computed from a vertex and its neighbours changes one
// edge farther, and so on from layer to layer of the mesh network.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "nn/body/body.h"
#include "nn/core/rows.h"

namespace doppel {

class MovedRows {
public:
    MovedRows(Graph& graph, const BodyModel& body, int mostEdges);

    // Rows of vertices within so many edges of those that skinning moves in the body's own frame.
    const ListedRows& within(int edges) const { return lists_[static_cast<size_t>(edges)]; }
    // Those within mostEdges, or all where the body turns or moves as a whole.
    const ListedRows& placed() const { return lists_[mostEdges_ + 1]; }

    // Lists for the next replay what differs from the last one's; theta [72], trans [3].
    void write(std::span<const float> theta, std::span<const float> trans);
    // All rows are to be computed next: the body has another shape.
    void forget() { last_.reset(); }

private:
    using Marks = std::vector<uint8_t>;  // not 0 where one of kRowsListed rows is meant
    struct Pose {
        std::vector<float> theta, trans;
    };

    RowLists lists_;
    size_t mostEdges_;
    bool blends_;                            // pose blend shapes: every joint moves every vertex
    std::vector<std::vector<Marks>> reach_;  // [24][mostEdges + 1] of what a joint's turn moves
    std::optional<Pose> last_;
};

}  // namespace doppel
