#include "viewer/pose_editor.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "engine/error.h"
#include "engine/files/npz.h"
#include "trainer/motion/motion.h"

namespace doppel {

using nlohmann::json;

namespace {

constexpr size_t kLongestText = size_t{64} << 10;
constexpr double kLargestTime = 1e7;  // frames
constexpr double kSameTime = 1e-6;
constexpr double kMostFrames = 1e6;
// Beyond these a number is a mistake, and sums of it no longer mean anything.
constexpr double kLargestRotation = 1e3, kLargestTrans = 1e4, kLargestBeta = 1e2;

// Something from the clipboard in an error: one short line.
std::string asShown(const json& value) {
    std::string text = value.dump(-1, ' ', true, json::error_handler_t::replace);
    constexpr size_t kShown = 60;
    if (text.size() > kShown) text = text.substr(0, kShown) + "…";
    return text;
}

// `count` numbers, none larger than `largest` to either side.
std::vector<double> numbers(const json& value, const std::string& field, size_t count,
                            double largest) {
    const auto fail = [&](const std::string& found) {
        throwInput("clipboard: {}: expected {} numbers from {} to {}, found {}", field, count,
                   -largest, largest, found);
    };
    if (!value.is_array()) fail(asShown(value));
    if (value.size() != count) fail(fmt::format("{} of them", value.size()));
    std::vector<double> result;
    for (const json& element : value) {
        if (!element.is_number()) fail(asShown(element));
        const double number = element.get<double>();
        if (!(std::abs(number) <= largest)) fail(asShown(element));
        result.push_back(number);
    }
    return result;
}

glm::dvec3 vectorOf(const std::vector<double>& v) { return {v[0], v[1], v[2]}; }

json arrayOf(const glm::dvec3& v) { return json::array({v.x, v.y, v.z}); }

void requireFps(double fps, const char* what) {
    if (!(fps > 0) || !(fps <= 10000))
        throwInput("{}: expected frames per second, above 0 and up to 10000, found {}", what, fps);
}

void writePoses(const std::filesystem::path& out, std::span<const Pose> poses, const Betas& betas,
                double fps, std::span<const double> times) {
    std::vector<Theta> theta;
    std::vector<Trans> trans;
    for (const Pose& pose : poses) {
        theta.push_back(thetaOf(pose));
        trans.push_back(transOf(pose));
    }
    Npz arrays = posesArrays(theta, trans, betas);
    arrays.set("fps", Array::scalarF64(fps));
    if (!times.empty())
        arrays.set("key_times", Array::f64({static_cast<int64_t>(times.size())}, times));
    writeNpz(out, arrays, false);
}

}  // namespace

PoseEditor::PoseEditor(const Pose& pose, const Betas& betas, size_t history)
    : history_(history), openedPose_(pose), openedBetas_(betas) {
    now_.pose = pose;
    now_.betas = betas;
}

// ---- steps --------------------------------------------------------------------------------------

void PoseEditor::push(std::string_view name, State before) {
    future_.clear();
    past_.push_back({std::string(name), std::move(before)});
    if (past_.size() > history_) past_.pop_front();
}

void PoseEditor::change(std::string_view name, State next) {
    if (next == now_) return;
    if (!inGesture_) push(name, now_);
    now_ = std::move(next);
}

void PoseEditor::changeKeyframes(std::string_view name, std::vector<Keyframe> keyframes) {
    State next = now_;
    next.keyframes = std::make_shared<const std::vector<Keyframe>>(std::move(keyframes));
    change(name, std::move(next));
}

void PoseEditor::beginGesture(std::string_view name) {
    endGesture();
    inGesture_ = true;
    gesture_ = name;
    began_ = now_;
}

void PoseEditor::endGesture() {
    if (!inGesture_) return;
    inGesture_ = false;
    if (now_ != began_) push(gesture_, began_);
}

void PoseEditor::cancelGesture() {
    if (!inGesture_) return;
    inGesture_ = false;
    now_ = began_;
}

void PoseEditor::undo() {
    if (inGesture_) return cancelGesture();
    if (past_.empty()) return;
    Step step = std::move(past_.back());
    past_.pop_back();
    future_.push_back({std::move(step.name), std::exchange(now_, std::move(step.other))});
}

void PoseEditor::redo() {
    if (!canRedo()) return;
    Step step = std::move(future_.back());
    future_.pop_back();
    past_.push_back({std::move(step.name), std::exchange(now_, std::move(step.other))});
}

std::string_view PoseEditor::undoName() const {
    if (inGesture_) return canUndo() ? std::string_view(gesture_) : std::string_view();
    return past_.empty() ? std::string_view() : past_.back().name;
}

std::string_view PoseEditor::redoName() const {
    return canRedo() ? std::string_view(future_.back().name) : std::string_view();
}

// ---- edits --------------------------------------------------------------------------------------

void PoseEditor::setPose(const Pose& pose, std::string_view what) {
    CHECK(isFinite(pose), "a pose's numbers are finite");
    State next = now_;
    next.pose = pose;
    change(what, std::move(next));
}

void PoseEditor::setBetas(const Betas& betas, std::string_view what) {
    CHECK(std::all_of(betas.begin(), betas.end(), [](float b) { return std::isfinite(b); }),
          "a shape's numbers are finite");
    State next = now_;
    next.betas = betas;
    change(what, std::move(next));
}

void PoseEditor::show(const Pose& pose) {
    CHECK(isFinite(pose), "a pose's numbers are finite");
    endGesture();
    now_.pose = openedPose_ = pose;
}

void PoseEditor::resetJoint(size_t joint) {
    setPose(doppel::resetJoint(now_.pose, joint, openedPose_),
            fmt::format("reset {}", jointName(joint)));
}

void PoseEditor::resetPose() { setPose(openedPose_, "reset pose"); }
void PoseEditor::resetBetas() { setBetas(openedBetas_, "reset shape"); }
void PoseEditor::mirror() { setPose(mirrored(now_.pose), "mirror"); }

// ---- clipboard ----------------------------------------------------------------------------------

std::string PoseEditor::copy() const {
    // A joint a line, for people who look at it.
    std::string text = "{\"doppel_pose\": 1,\n \"joints\": {\n";
    for (size_t j = 0; j < joint::kCount; ++j)
        text += fmt::format("  \"{}\": {}{}\n", jointName(j), arrayOf(now_.pose.rotation[j]).dump(),
                            j + 1 < joint::kCount ? "," : "},");
    text += fmt::format(" \"trans\": {},\n", arrayOf(now_.pose.trans).dump());
    return text + fmt::format(" \"betas\": {}}}\n", json(now_.betas).dump());
}

void PoseEditor::paste(std::string_view text) {
    if (text.size() > kLongestText)
        throwInput("clipboard: expected a pose of at most {} bytes, found {}", kLongestText,
                   text.size());
    json document;
    try {
        document = json::parse(text);
    } catch (const json::parse_error& problem) {
        throwInput("clipboard: expected a pose as JSON, found an error at byte {}", problem.byte);
    } catch (const json::out_of_range&) {
        // A number beyond the range of double.
        throwInput("clipboard: expected finite numbers, found one that is too large");
    }
    if (!document.is_object() || !document.contains("doppel_pose"))
        throwInput("clipboard: expected a pose, {{\"doppel_pose\": 1, …}}, found {}",
                   document.is_object() ? "an object without doppel_pose" : asShown(document));
    if (document["doppel_pose"] != 1)
        throwInput("clipboard: doppel_pose: expected version 1, found {}",
                   asShown(document["doppel_pose"]));
    State next = now_;
    bool any = false;
    for (const auto& [field, value] : document.items()) {
        if (field == "doppel_pose") continue;
        any = true;
        if (field == "joints") {
            if (!value.is_object())
                throwInput("clipboard: joints: expected an object of rotations, found {}",
                           asShown(value));
            for (const auto& [name, rotation] : value.items()) {
                const std::optional<size_t> joint = jointNumber(name);
                if (!joint)
                    throwInput("clipboard: joints: expected names such as left_wrist, found {}",
                               asShown(name));
                next.pose.rotation[*joint] =
                    vectorOf(numbers(rotation, "joints: " + name, 3, kLargestRotation));
            }
        } else if (field == "trans") {
            next.pose.trans = vectorOf(numbers(value, field, 3, kLargestTrans));
        } else if (field == "betas") {
            const std::vector<double> betas =
                numbers(value, field, next.betas.size(), kLargestBeta);
            std::transform(betas.begin(), betas.end(), next.betas.begin(),
                           [](double beta) { return static_cast<float>(beta); });
        } else {
            throwInput("clipboard: expected joints, trans and betas, found {}", asShown(field));
        }
    }
    if (!any) throwInput("clipboard: expected joints, trans or betas, found none of them");
    change("paste", std::move(next));
}

// ---- keyframes ----------------------------------------------------------------------------------

namespace {

// The first keyframe at this time or later.
template <typename Keyframes>
auto firstFrom(Keyframes& keyframes, double time) {
    return std::lower_bound(keyframes.begin(), keyframes.end(), time - kSameTime,
                            [](const Keyframe& keyframe, double t) { return keyframe.time < t; });
}

}  // namespace

void PoseEditor::setKeyframe(double time) {
    if (!(std::abs(time) <= kLargestTime))
        throwInput("keyframe: expected a time from {} to {} frames, found {}", -kLargestTime,
                   kLargestTime, time);
    std::vector<Keyframe> keyframes = *now_.keyframes;
    const auto at = firstFrom(keyframes, time);
    if (at != keyframes.end() && at->time <= time + kSameTime)
        at->pose = now_.pose;
    else
        keyframes.insert(at, {time, now_.pose});
    changeKeyframes("set keyframe", std::move(keyframes));
}

bool PoseEditor::removeKeyframe(double time) {
    std::vector<Keyframe> keyframes = *now_.keyframes;
    const auto at = firstFrom(keyframes, time);
    if (at == keyframes.end() || !(at->time <= time + kSameTime)) return false;
    keyframes.erase(at);
    changeKeyframes("remove keyframe", std::move(keyframes));
    return true;
}

void PoseEditor::clearKeyframes() { changeKeyframes("remove keyframes", {}); }

Pose PoseEditor::poseAt(double time) const {
    const std::vector<Keyframe>& keyframes = *now_.keyframes;
    if (keyframes.empty() || std::isnan(time)) return now_.pose;
    const auto next =
        std::upper_bound(keyframes.begin(), keyframes.end(), time,
                         [](double t, const Keyframe& keyframe) { return t < keyframe.time; });
    if (next == keyframes.begin()) return next->pose;
    const Keyframe& from = *std::prev(next);
    if (next == keyframes.end() || from.time == time) return from.pose;
    const double share = (time - from.time) / (next->time - from.time);
    Pose pose;
    for (size_t j = 0; j < joint::kCount; ++j)
        pose.rotation[j] = axisAngleOf(glm::slerp(quaternionOf(from.pose.rotation[j]),
                                                  quaternionOf(next->pose.rotation[j]), share));
    pose.trans = glm::mix(from.pose.trans, next->pose.trans, share);
    return pose;
}

void PoseEditor::saveKeyframes(const std::filesystem::path& out, double timelineFps) const {
    requireFps(timelineFps, "timeline");
    if (keyframes().empty())
        throwInput("{}: expected keyframes to save, found none; set one first", out.string());
    std::vector<Pose> poses;
    std::vector<double> times;
    for (const Keyframe& keyframe : keyframes()) {
        poses.push_back(keyframe.pose);
        times.push_back(keyframe.time);
    }
    writePoses(out, poses, now_.betas, timelineFps, times);
}

void PoseEditor::saveSampled(const std::filesystem::path& out, double timelineFps,
                             double fps) const {
    requireFps(timelineFps, "timeline");
    requireFps(fps, "fps");
    if (keyframes().empty())
        throwInput("{}: expected keyframes to save, found none; set one first", out.string());
    const double first = keyframes().front().time, last = keyframes().back().time;
    const double step = timelineFps / fps;
    const double count = std::floor((last - first) / step + 1e-9) + 1;
    if (count > kMostFrames)
        throwInput("{}: expected at most {} frames, found {} between the first and last keyframe",
                   out.string(), kMostFrames, count);
    std::vector<Pose> poses;
    for (int64_t i = 0; i < static_cast<int64_t>(count); ++i)
        poses.push_back(poseAt(std::min(first + static_cast<double>(i) * step, last)));
    writePoses(out, poses, now_.betas, fps, {});
}

void PoseEditor::loadKeyframes(const std::filesystem::path& file) {
    const Motion motion = readMotion(file);
    std::vector<double> times;
    std::error_code error;
    if (file.extension() == ".npz" && !std::filesystem::is_directory(file, error)) {
        const Npz arrays = readNpz(file);
        if (const Array* array = arrays.find("key_times")) {
            array->requireShape({static_cast<int64_t>(motion.size())});
            times = array->toF64();
        }
    }
    const bool timed = !times.empty();
    std::vector<Keyframe> keyframes;
    for (size_t i = 0; i < motion.size(); ++i) {
        const double time = timed ? times[i] : static_cast<double>(i);
        if (!(std::abs(time) <= kLargestTime) ||
            (i > 0 && !(time > keyframes.back().time + kSameTime)))
            throwInput("{}: key_times: expected growing times up to {} frames, found {} in row {}",
                       file.string(), kLargestTime, time, i);
        keyframes.push_back({time, poseOf(motion.theta[i], motion.trans[i])});
    }
    State next = now_;
    next.betas = motion.betas;
    next.keyframes = std::make_shared<const std::vector<Keyframe>>(std::move(keyframes));
    change("load keyframes", std::move(next));
}

}  // namespace doppel
