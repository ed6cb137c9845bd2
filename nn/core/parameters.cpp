#include "nn/core/parameters.h"

#include <algorithm>

namespace doppel {

void Parameters::add(std::string name, Shape shape, std::vector<float> values) {
    CHECK(!allocated(), "parameters are declared before they are allocated");
    CHECK(!find(name), "parameter {} is declared once", name);
    CHECK(static_cast<int64_t>(values.size()) == elementCount(shape), "{} values fill {}",
          values.size(), toString(shape));
    initial_.resize(bytes_ / 4);
    initial_.insert(initial_.end(), values.begin(), values.end());
    entries_.push_back({std::move(name), std::move(shape), bytes_});
    bytes_ = alignUp(initial_.size() * 4, kBufferAlignment);
}

void Parameters::allocate(Device& device) {
    CHECK(!entries_.empty() && !allocated(), "there are parameters, allocated once");
    device_ = &device;
    buffer_ = device.allocate(bytes_ * kSectionCount, Memory::Device);
    initial_.resize(bytes_ / 4 * kSectionCount, 0.0f);
    device.upload({&buffer_, 0, buffer_.bytes()}, std::as_bytes(std::span(initial_)));
    initial_.clear();
    initial_.shrink_to_fit();
}

const Parameters::Entry* Parameters::find(std::string_view name) const {
    auto found = std::ranges::find(entries_, name, &Entry::name);
    return found == entries_.end() ? nullptr : &*found;
}

BufferView Parameters::section(Section section) const {
    return {&buffer_, bytes_ * static_cast<uint64_t>(section), bytes_};
}

BufferView Parameters::view(const Entry& entry, Section section) const {
    return {&buffer_, bytes_ * static_cast<uint64_t>(section) + entry.offset,
            static_cast<uint64_t>(elementCount(entry.shape)) * 4};
}

std::vector<float> Parameters::read(const Entry& entry, Section section) const {
    std::vector<float> values(static_cast<size_t>(elementCount(entry.shape)));
    device_->download(view(entry, section), std::as_writable_bytes(std::span(values)));
    return values;
}

void Parameters::write(const Entry& entry, std::span<const float> values, Section section) {
    CHECK(static_cast<int64_t>(values.size()) == elementCount(entry.shape),
          "{} values fill parameter {}", values.size(), entry.name);
    device_->upload(view(entry, section), std::as_bytes(values));
}

void Parameters::broadcast(Ranks& ranks) {
    const BufferView all{&buffer_, 0, buffer_.bytes()};
    std::vector<std::byte> bytes(all.bytes);
    if (ranks.rank() == 0) device_->download(all, bytes);
    ranks.broadcast(bytes.data(), bytes.size());
    if (ranks.rank() != 0) device_->upload(all, bytes);
}

}  // namespace doppel
