#include "viewer/compare/company.h"

#include <algorithm>
#include <set>

#include "engine/error.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// The last names of a path, so many of them.
std::string lastNames(const fs::path& path, int count) {
    fs::path rest = fs::absolute(path).lexically_normal(), names;
    if (!rest.has_filename()) rest = rest.parent_path();
    for (; count > 0 && rest.has_relative_path(); --count, rest = rest.parent_path())
        names = names.empty() ? rest.filename() : rest.filename() / names;
    return names.string();
}

// How high the pelvis of this body is above its soles at rest, metres.
double pelvisHeight(const BodyModel& body, const Betas& betas) {
    const Skeleton skeleton = skeletonOf(body, betas);
    // Ankles are as high above the soles in all bodies, to some millimetres.
    return skeleton.rest[joint::kPelvis].y -
           (skeleton.rest[joint::kLeftAnkle].y + skeleton.rest[joint::kRightAnkle].y) / 2;
}

}  // namespace

void Company::add(const fs::path& folder) {
    auto added = std::make_unique<Compared>(device_, folder);
    std::error_code error;
    const auto same = std::ranges::find_if(others_, [&](const std::unique_ptr<Compared>& other) {
        return fs::equivalent(other->folder(), folder, error);
    });
    if (same != others_.end()) {
        *same = std::move(added);
    } else {
        if (others_.size() >= kMost)
            throwInput("{}: expected at most {} avatars beside the one that is edited",
                       folder.string(), kMost);
        others_.push_back(std::move(added));
    }
    ++version_;
}

void Company::remove(size_t i) {
    others_.erase(others_.begin() + static_cast<std::ptrdiff_t>(i));
    ++version_;
}

bool Company::reload() {
    bool changed = false;
    for (const std::unique_ptr<Compared>& other : others_) changed |= other->reload();
    version_ += changed;
    return changed;
}

glm::dvec3 Company::offset(size_t i, const Betas& betas, const Avatar& edited,
                           const Row& row) const {
    // Right, left, further right, …
    const double place = (i % 2 == 0 ? 1. : -1.) * (1. + static_cast<double>(i / 2)) * row.apart;
    const Compared& other = *others_[i];
    const double higher = pelvisHeight(other.avatar().body, other.betasFor(betas, edited)) -
                          pelvisHeight(edited.body, betas);
    return glm::dvec3(place, 0, 0) + higher * row.up;
}

void Company::setPose(const Pose& pose, const Betas& betas, const Avatar& edited,
                      const std::optional<Row>& row) {
    for (size_t i = 0; i < others_.size(); ++i) {
        Pose own = pose;
        if (row) own.trans += offset(i, betas, edited, *row);
        others_[i]->setPose(thetaOf(own), transOf(own), betas, edited);
    }
}

std::vector<std::string> namesOf(const std::vector<fs::path>& folders) {
    constexpr int kMostNames = 2;
    std::vector<std::string> names;
    for (int count = 1; count <= kMostNames; ++count) {
        names.clear();
        for (const fs::path& folder : folders) names.push_back(lastNames(folder, count));
        if (std::set(names.begin(), names.end()).size() == names.size()) break;
    }
    return names;
}

}  // namespace doppel
