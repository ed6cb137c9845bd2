// What training changes: named tensors in one flat buffer, beside their gradients and the
// optimiser's moments, so that one dispatch updates them all.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "engine/device.h"
#include "nn/core/ranks.h"
#include "nn/core/tensor.h"

namespace doppel {

class Parameters {
public:
    struct Entry {
        std::string name;
        Shape shape;
        uint64_t offset = 0;  // bytes
    };

    // Declares one; values start as given (as many as the shape has elements). Before allocate().
    void add(std::string name, Shape shape, std::vector<float> values);
    // Moves the values to the device. Gradients and moments start at zero.
    void allocate(Device& device);
    bool allocated() const { return static_cast<bool>(buffer_); }

    const std::vector<Entry>& entries() const { return entries_; }
    const Entry* find(std::string_view name) const;
    uint64_t elements() const { return bytes_ / 4; }  // padding between tensors included

    // The four flat arrays: values, gradient, first and second moment.
    enum Section { kValues, kGradient, kMoment1, kMoment2, kSectionCount };
    BufferView section(Section section) const;
    BufferView view(const Entry& entry, Section section) const;

    std::vector<float> read(const Entry& entry, Section section = kValues) const;
    void write(const Entry& entry, std::span<const float> values, Section section = kValues);

    // Values, gradients and moments become rank 0's.
    void broadcast(Ranks& ranks);

private:
    Device* device_ = nullptr;
    std::vector<Entry> entries_;
    std::vector<float> initial_;
    uint64_t bytes_ = 0;
    Buffer buffer_;
};

}  // namespace doppel
