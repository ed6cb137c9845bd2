#include "nn/body/moved_rows.h"

#include <algorithm>

#include "nn/body/mesh_topology.h"

namespace doppel {

namespace {

constexpr auto kJoints = static_cast<size_t>(BodyModel::kJoints);

bool hangsOn(const BodyModel& body, size_t joint, size_t other) {
    auto at = static_cast<int32_t>(joint);
    while (at >= 0 && at != static_cast<int32_t>(other)) at = body.parents[static_cast<size_t>(at)];
    return at >= 0;
}

}  // namespace

MovedRows::MovedRows(Graph& graph, const BodyModel& body, int mostEdges)
    : lists_(graph, body.vertexCount, static_cast<size_t>(mostEdges) + 2),
      mostEdges_(static_cast<size_t>(mostEdges)),
      blends_(!body.poseDirections.empty()) {
    const auto vertices = static_cast<size_t>(body.vertexCount);
    Adjacency near = meshTopology(body.faces, body.vertexCount, body.file).adjacency;
    for (size_t joint = 0; joint < kJoints; ++joint) {
        std::vector<int32_t> reached;  // nearest first
        std::vector<uint8_t> isReached(vertices);
        auto reach = [&](size_t vertex) {
            if (!isReached[vertex]) reached.push_back(static_cast<int32_t>(vertex));
            isReached[vertex] = 1;
        };
        for (size_t other = 0; other < kJoints; ++other)
            for (size_t v = 0; hangsOn(body, other, joint) && v < vertices; ++v)
                if (body.weights[v * kJoints + other] != 0) reach(v);
        Marks marks(lists_.count());
        for (size_t edges = 0, marked = 0, end = reached.size(); edges <= mostEdges_; ++edges) {
            for (size_t i = marked; i < end; ++i) marks[size_t(reached[i]) / kRowsListed] = 1;
            reach_.resize(joint + 1);
            reach_.back().push_back(marks);
            for (size_t i = marked; i < end; ++i)
                for (int32_t n = near.begin[size_t(reached[i])];
                     n < near.begin[size_t(reached[i]) + 1]; ++n)
                    reach(size_t(near.neighbours[size_t(n)]));
            marked = end;
            end = reached.size();
        }
    }
}

void MovedRows::write(std::span<const float> theta, std::span<const float> trans) {
    auto differs = [](std::span<const float> a, std::span<const float> b) {
        return !std::ranges::equal(a, b);
    };
    std::vector<Marks> wanted(mostEdges_ + 2, Marks(lists_.count(), last_ ? 0 : 1));
    bool turned = false;
    for (size_t joint = 1; joint < kJoints && last_; ++joint) {
        if (!differs(theta.subspan(3 * joint, 3), std::span(last_->theta).subspan(3 * joint, 3)))
            continue;
        turned = true;
        for (size_t edges = 0; edges <= mostEdges_; ++edges)
            for (size_t i = 0; i < lists_.count(); ++i) wanted[edges][i] |= reach_[joint][edges][i];
    }
    if (turned && blends_)
        for (Marks& marks : wanted) std::ranges::fill(marks, uint8_t{1});
    bool placed = !last_ || differs(trans, last_->trans) ||
                  differs(theta.first(3), std::span(last_->theta).first(3));
    if (placed)
        std::ranges::fill(wanted[mostEdges_ + 1], uint8_t{1});
    else
        wanted[mostEdges_ + 1] = wanted[mostEdges_];
    lists_.write(wanted);
    last_ = Pose{{theta.begin(), theta.end()}, {trans.begin(), trans.end()}};
}

}  // namespace doppel
