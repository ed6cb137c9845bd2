// The avatars that are seen together with the one that is edited, in its pose.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "viewer/compare/compared.h"
#include "viewer/pose/skeleton.h"

namespace doppel {

class Company {
public:
    explicit Company(Device& device) : device_(device) {}

    // InputError, with nothing changed, where there is no avatar, or there are kMost already. One
    // that is among them is read anew.
    void add(const std::filesystem::path& folder);
    void remove(size_t i);
    static constexpr size_t kMost = 7;

    size_t size() const { return others_.size(); }
    bool empty() const { return others_.empty(); }
    Compared& operator[](size_t i) { return *others_[i]; }
    const Compared& operator[](size_t i) const { return *others_[i]; }
    // Whether one of them has changed on disk, and is shown as it is now.
    bool reload();
    // Counts what has changed of them.
    uint64_t version() const { return version_; }

    // All as in `pose`, of the shape betas that was made of `edited`. apart: they stand in a row
    // with the one that is edited in its middle, so far from each other, metres, on one floor; up:
    // of length 1; nothing: all of them where the edited one is.
    struct Row {
        double apart = 0;
        glm::dvec3 up{0, -1, 0};
    };
    void setPose(const Pose& pose, const Betas& betas, const Avatar& edited,
                 const std::optional<Row>& row);
    // From the edited one's place to that of the i-th.
    glm::dvec3 offset(size_t i, const Betas& betas, const Avatar& edited, const Row& row) const;

private:
    Device& device_;
    std::vector<std::unique_ptr<Compared>> others_;
    uint64_t version_ = 0;
};

// The names of avatars' folders, with those of the folders around where they are the same: `doppel
// avatar` calls all avatars "avatar".
std::vector<std::string> namesOf(const std::vector<std::filesystem::path>& folders);

}  // namespace doppel
