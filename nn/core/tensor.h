// Tensors of a graph. A Tensor is a view: it names storage that the graph plans and owns.
//
// Our words, one per thing: capture (a recorded sequence), frame, mask (observed), silhouette
// (rendered), keypoints, template mesh, pose theta, shape beta, joint regressor, LBS, offsets
// (learnt), visibility buffer (triangle, barycentrics, depth per pixel), visibility map (UV space,
// which texels face the camera), UV, atlas, texel, seam, stage, step, replay, driving motion,
// reenactment. dX is dL/dX. One letter per dimension: N batch, B frames, V vertices, F faces,
// J joints, E edges, C channels, H W, T texels.
#pragma once

#include <cstdint>
#include <numeric>
#include <string>
#include <vector>

#include "engine/error.h"

namespace doppel {

enum class ElementType : uint8_t { F32, I32 };  // both four bytes per element

using Shape = std::vector<int64_t>;  // outermost first, C order; {} is a scalar

inline int64_t elementCount(const Shape& shape) {
    return std::accumulate(shape.begin(), shape.end(), int64_t{1}, std::multiplies<>());
}
inline std::string toString(const Shape& shape) {
    return fmt::format("[{}]", fmt::join(shape, ","));
}

struct Tensor {
    int storage = -1;     // the graph's number for the memory; -1: no tensor
    uint64_t offset = 0;  // bytes into it
    Shape shape;
    ElementType type = ElementType::F32;

    explicit operator bool() const { return storage >= 0; }
    int64_t elements() const { return elementCount(shape); }
    uint64_t bytes() const { return static_cast<uint64_t>(elements()) * 4; }
    // Negative numbers count from the end, as in dim(-1).
    int64_t dim(int i) const { return shape.at(i < 0 ? shape.size() + size_t(i) : size_t(i)); }
    // The same elements under another shape.
    Tensor reshaped(Shape other) const {
        CHECK(elementCount(other) == elements(), "{} has as many elements as {}", toString(other),
              toString(shape));
        Tensor result = *this;
        result.shape = std::move(other);
        return result;
    }
    // Rows [begin, begin + count) of the first dimension. No gradient flows through a slice.
    Tensor slice(int64_t begin, int64_t count) const {
        CHECK(begin >= 0 && count >= 0 && begin + count <= dim(0), "rows {}..{} are in {}", begin,
              begin + count, toString(shape));
        Tensor result = *this;
        result.offset += bytes() / static_cast<uint64_t>(dim(0)) * static_cast<uint64_t>(begin);
        result.shape[0] = count;
        return result;
    }
};

}  // namespace doppel
