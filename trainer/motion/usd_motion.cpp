// Animations of USD's skeletons (UsdSkel) in text files, as `doppel export --out FILE.usda` writes
// them: one Skeleton and one SkelAnimation of all its joints in the same order, with a sample for
// each frame. https://openusd.org/release/api/usd_skel_page_front.html
#include <algorithm>
#include <charconv>
#include <cmath>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/printable.h"
#include "trainer/data/capture_notes.h"
#include "trainer/motion/skeleton_motion.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr uint64_t kMostBytes = uint64_t{1} << 30;
constexpr size_t kMostJoints = 1000, kMostFrames = 1'000'000;

struct Samples {
    std::vector<double> times;
    std::vector<std::vector<double>> rows;
};

class UsdText {
public:
    UsdText(std::string_view text, std::string file) : text_(text), file_(std::move(file)) {}

    const std::string& file() const { return file_; }

    // Goes behind the first place where this stands.
    void find(std::string_view word) {
        const size_t found = text_.find(word);
        if (found == std::string_view::npos)
            throwInput(
                "{}: expected {}, found none; of USD only what `doppel export --motion` "
                "writes is read as a motion",
                file_, word);
        at_ = found + word.size();
    }
    bool has(std::string_view word) const { return text_.find(word) != std::string_view::npos; }

    double number() {
        skip(" \t\r\n");
        double value = 0;
        const auto [rest, error] =
            std::from_chars(text_.data() + at_, text_.data() + text_.size(), value);
        if (error != std::errc() || !std::isfinite(value))
            throwInput("{}: expected a number, found \"{}\"", file_,
                       printable(text_.substr(at_, 20), 20));
        at_ = static_cast<size_t>(rest - text_.data());
        return value;
    }

    // Between brackets, whatever tuples they stand in.
    std::vector<double> numbers() {
        take('[');
        std::vector<double> all;
        for (skip(kBetween); peek() != ']'; skip(kBetween)) all.push_back(number());
        take(']');
        return all;
    }

    std::vector<std::string> words() {
        take('[');
        std::vector<std::string> all;
        for (skip(kBetween); peek() == '"'; skip(kBetween)) {
            const size_t end = text_.find('"', ++at_);
            if (end == std::string_view::npos)
                throwInput("{}: expected the end of a name, found the end of the file", file_);
            all.emplace_back(text_.substr(at_, end - at_));
            at_ = end + 1;
        }
        take(']');
        return all;
    }

    Samples samples(size_t width) {
        take('{');
        Samples found;
        for (skip(kBetween); peek() != '}'; skip(kBetween)) {
            found.times.push_back(number());
            take(':');
            found.rows.push_back(numbers());
            if (found.rows.back().size() != width)
                throwInput("{}: expected {} numbers in a sample, found {}", file_, width,
                           found.rows.back().size());
            if (found.rows.size() > kMostFrames)
                throwInput("{}: expected at most {} samples, found more", file_, kMostFrames);
        }
        return found;
    }

private:
    static constexpr std::string_view kBetween = " \t\r\n,()";

    char peek() const { return at_ < text_.size() ? text_[at_] : '\0'; }
    void skip(std::string_view characters) {
        at_ = std::min(text_.find_first_not_of(characters, at_), text_.size());
    }
    void take(char expected) {
        skip(" \t\r\n");
        if (peek() != expected)
            throwInput("{}: expected '{}', found \"{}\"", file_, expected,
                       printable(text_.substr(at_, 20), 20));
        ++at_;
    }

    std::string_view text_;
    std::string file_;
    size_t at_ = 0;
};

// "hips/spine/chest" hangs on "hips/spine", which comes before it.
std::vector<SkeletonMotion::Joint> jointsOf(const std::vector<std::string>& paths,
                                            const std::string& file) {
    if (paths.empty() || paths.size() > kMostJoints)
        throwInput("{}: joints: expected 1 to {}, found {}", file, kMostJoints, paths.size());
    std::vector<SkeletonMotion::Joint> joints;
    for (size_t j = 0; j < paths.size(); ++j) {
        const size_t slash = paths[j].rfind('/');
        if (slash == std::string::npos) {
            if (j > 0)
                throwInput("{}: joints: expected one root, found {} beside {}", file,
                           printable(paths[j]), printable(paths[0]));
            joints.push_back({paths[j], -1});
            continue;
        }
        const auto end = paths.begin() + std::ptrdiff_t(j);
        const auto above = std::find(paths.begin(), end, paths[j].substr(0, slash));
        if (above == end)
            throwInput("{}: joints: expected the joint above {} before it, found none", file,
                       printable(paths[j]));
        joints.push_back({paths[j].substr(slash + 1), static_cast<int>(above - paths.begin())});
    }
    return joints;
}

// Down the tree from what each joint has in its parent's frame.
SkeletonMotion::Placement placementOf(const std::vector<SkeletonMotion::Joint>& joints,
                                      const std::vector<glm::dquat>& turns,
                                      const std::vector<glm::dvec3>& moves) {
    SkeletonMotion::Placement placed;
    for (size_t j = 0; j < joints.size(); ++j) {
        if (joints[j].parent < 0) {
            placed.rotation.push_back(turns[j]);
            placed.position.push_back(moves[j]);
            continue;
        }
        const auto parent = static_cast<size_t>(joints[j].parent);
        placed.rotation.push_back(placed.rotation[parent] * turns[j]);
        placed.position.push_back(placed.position[parent] + placed.rotation[parent] * moves[j]);
    }
    return placed;
}

// Matrices in rows, for vectors that stand before them: the last row moves.
SkeletonMotion::Placement restOf(UsdText& text, const std::vector<SkeletonMotion::Joint>& joints) {
    text.find("matrix4d[] restTransforms = ");
    const std::vector<double> values = text.numbers();
    if (values.size() != 16 * joints.size())
        throwInput("{}: restTransforms: expected {} matrices, found {} numbers", text.file(),
                   joints.size(), values.size());
    std::vector<glm::dquat> turns;
    std::vector<glm::dvec3> moves;
    for (size_t j = 0; j < joints.size(); ++j) {
        const double* m = &values[16 * j];
        turns.push_back(glm::normalize(
            glm::quat_cast(glm::dmat3(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]))));
        moves.emplace_back(m[12], m[13], m[14]);
    }
    return placementOf(joints, turns, moves);
}

SkeletonMotion::Placement frameOf(const std::vector<SkeletonMotion::Joint>& joints,
                                  const std::vector<double>& rotations,
                                  const std::vector<double>& translations,
                                  const std::string& file) {
    std::vector<glm::dquat> turns;
    std::vector<glm::dvec3> moves;
    for (size_t j = 0; j < joints.size(); ++j) {
        const double* q = &rotations[4 * j];  // w x y z
        const glm::dquat turn(q[0], q[1], q[2], q[3]);
        const double length = glm::length(turn);
        if (!(length > 1e-6) || !(length < 1e6))
            throwInput("{}: rotations: expected quaternions, found one of length {}", file, length);
        turns.push_back(turn / length);
        moves.emplace_back(translations[3 * j], translations[3 * j + 1], translations[3 * j + 2]);
    }
    return placementOf(joints, turns, moves);
}

double rateOf(UsdText& text, const std::vector<double>& times) {
    double codes = 24;  // a second, where a file does not say it
    if (text.has("timeCodesPerSecond = ")) {
        text.find("timeCodesPerSecond = ");
        codes = text.number();
    }
    const double step = times.size() > 1 ? (times.back() - times[0]) / double(times.size() - 1) : 1;
    return checkedFps(codes / step, text.file() + ": timeCodesPerSecond");
}

Motion readUsdMotion(const fs::path& path) {
    const std::vector<uint8_t> bytes = readWholeFile(path, kMostBytes);
    UsdText text({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, path.string());
    text.find("token[] joints = ");
    const std::vector<std::string> paths = text.words();
    const auto joints = jointsOf(paths, text.file());
    const SkeletonMotion::Placement rest = restOf(text, joints);
    text.find("def SkelAnimation");
    text.find("translations.timeSamples = ");
    const Samples translations = text.samples(3 * joints.size());
    text.find("rotations.timeSamples = ");
    const Samples rotations = text.samples(4 * joints.size());
    if (rotations.times.empty() || rotations.times != translations.times ||
        !std::ranges::is_sorted(rotations.times, std::less_equal{}))
        throwInput(
            "{}: timeSamples: expected translations and rotations at the same rising times, "
            "found {} and {}",
            text.file(), translations.times.size(), rotations.times.size());
    const double rate = rateOf(text, rotations.times);
    double metres = .01;  // where a file does not say it
    if (text.has("metersPerUnit = ")) {
        text.find("metersPerUnit = ");
        metres = text.number();
    }
    return motionFromSkeleton({text.file(), "restTransforms", joints, rotations.rows.size(),
                               1 / rate, metres, [&](int64_t frame) {
                                   if (frame < 0) return rest;
                                   const auto f = static_cast<size_t>(frame);
                                   return frameOf(joints, rotations.rows[f], translations.rows[f],
                                                  text.file());
                               }});
}

const MotionFormat kUsd{{
    .looks = "a USD animation as export writes it (.usda)",
    .ending = ".usda",
    .recognises = [](const fs::path&,
                     std::string_view begin) { return begin.starts_with("#usda 1.0"); },
    .read = readUsdMotion,
}};

}  // namespace

}  // namespace doppel
