#include "viewer/pose/pose_text.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "viewer/pose/json_text.h"

namespace doppel {

using nlohmann::json;

namespace {

constexpr size_t kLongestText = size_t{64} << 10;
constexpr size_t kMostKeys = 200'000;
// Beyond these a number is a mistake, and sums of it no longer mean anything.
constexpr double kLargestRotation = 1e3, kLargestTrans = 1e4, kLargestBeta = 1e2;

// Something from the clipboard in an error: one short line.
std::string asShown(const json& value) {
    std::string text = value.dump(-1, ' ', true, json::error_handler_t::replace);
    constexpr size_t kShown = 60;
    if (text.size() > kShown) text = text.substr(0, kShown) + "…";
    return text;
}

// `count` numbers, none larger than `largest` to either side. field: with what it lies in.
std::vector<double> numbers(const json& value, const std::string& field, size_t count,
                            double largest) {
    const auto fail = [&](const std::string& found) {
        throwInput("{}: expected {} numbers from {} to {}, found {}", field, count, -largest,
                   largest, found);
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

double number(const json& value, const std::string& field, double low, double high) {
    if (!value.is_number() || !(value.get<double>() >= low) || !(value.get<double>() <= high))
        throwInput("{}: expected a number from {} to {}, found {}", field, low, high,
                   asShown(value));
    return value.get<double>();
}

glm::dvec3 vectorOf(const std::vector<double>& v) { return {v[0], v[1], v[2]}; }

json arrayOf(const glm::dvec3& v) { return json::array({v.x, v.y, v.z}); }

Betas betasOf(const json& value, const std::string& field) {
    Betas betas{};
    const std::vector<double> found = numbers(value, field, betas.size(), kLargestBeta);
    std::transform(found.begin(), found.end(), betas.begin(),
                   [](double beta) { return static_cast<float>(beta); });
    return betas;
}

// A pose as 72 numbers and its place.
json compact(const Pose& pose) {
    json rotations = json::array();
    for (const glm::dvec3& rotation : pose.rotation)
        for (int k = 0; k < 3; ++k) rotations.push_back(rotation[k]);
    return {{"rotations", std::move(rotations)}, {"trans", arrayOf(pose.trans)}};
}

Pose poseIn(const json& value, const std::string& field) {
    if (!value.is_object() || !value.contains("rotations") || !value.contains("trans"))
        throwInput("{}: expected rotations and trans, found {}", field, asShown(value));
    const std::vector<double> found =
        numbers(value["rotations"], field + ": rotations", kThetaSize, kLargestRotation);
    Pose pose;
    for (size_t i = 0; i < found.size(); ++i)
        pose.rotation[i / 3][static_cast<int>(i % 3)] = found[i];
    pose.trans = vectorOf(numbers(value["trans"], field + ": trans", 3, kLargestTrans));
    return pose;
}

}  // namespace

// ---- poses --------------------------------------------------------------------------------------

std::string poseText(const Pose& pose, const Betas& betas) {
    // A joint a line, for people who look at it.
    std::string text = "{\"doppel_pose\": 1,\n \"joints\": {\n";
    for (size_t j = 0; j < joint::kCount; ++j)
        text += fmt::format("  \"{}\": {}{}\n", jointName(j), arrayOf(pose.rotation[j]).dump(),
                            j + 1 < joint::kCount ? "," : "},");
    text += fmt::format(" \"trans\": {},\n", arrayOf(pose.trans).dump());
    return text + fmt::format(" \"betas\": {}}}\n", json(betas).dump());
}

void readPoseText(std::string_view text, Pose& pose) {
    if (text.size() > kLongestText)
        throwInput("clipboard: expected a pose of at most {} bytes, found {}", kLongestText,
                   text.size());
    const json document = parsedJson(text, "clipboard", "a pose");
    if (!document.is_object() || !document.contains("doppel_pose"))
        throwInput("clipboard: expected a pose, {{\"doppel_pose\": 1, …}}, found {}",
                   document.is_object() ? "an object without doppel_pose" : asShown(document));
    if (document["doppel_pose"] != 1)
        throwInput("clipboard: doppel_pose: expected version 1, found {}",
                   asShown(document["doppel_pose"]));
    Pose next = pose;
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
                next.rotation[*joint] =
                    vectorOf(numbers(rotation, "clipboard: joints: " + name, 3, kLargestRotation));
            }
        } else if (field == "trans") {
            next.trans = vectorOf(numbers(value, "clipboard: trans", 3, kLargestTrans));
        } else if (field == "betas") {
            betasOf(value, "clipboard: betas");
        } else {
            throwInput("clipboard: expected joints, trans and betas, found {}", asShown(field));
        }
    }
    if (!any) throwInput("clipboard: expected joints, trans or betas, found none of them");
    pose = next;
}

// ---- sessions -----------------------------------------------------------------------------------

std::string sessionText(const Session& session) {
    json keys = json::array();
    for (const Keyframe& key : session.take.keys) {
        json entry = compact(key.pose);
        entry["time"] = key.time;
        keys.push_back(std::move(entry));
    }
    const json document = {{"doppel_session", 1},
                           {"avatar", session.avatar},
                           {"motion", session.motion},
                           {"frames", session.frames},
                           {"saved", session.saved},
                           {"when", session.when},
                           {"time", session.time},
                           {"edited", session.edited},
                           {"worn", session.worn},
                           {"fade", session.take.layer.fade},
                           {"overrides", session.take.layer.blend == Layer::Blend::Override},
                           {"betas", session.take.betas},
                           {"pose", compact(session.take.pose)},
                           {"keys", std::move(keys)}};
    // A path need not be UTF-8.
    return document.dump(-1, ' ', false, json::error_handler_t::replace);
}

Session readSessionText(std::string_view text, const std::string& name) {
    const json document = parsedJson(text, name, "a session");
    if (!document.is_object() || !document.contains("doppel_session") ||
        document["doppel_session"] != 1)
        throwInput("{}: expected a session, {{\"doppel_session\": 1, …}}, found {}", name,
                   document.is_object() ? "another object" : asShown(document));
    const auto member = [&](const char* field) -> const json& {
        if (!document.contains(field)) throwInput("{}: {}: it is missing", name, field);
        return document[field];
    };
    const auto wordsIn = [&](const json& value, const std::string& field) {
        if (!value.is_string() || value.get_ref<const std::string&>().size() > 4096)
            throwInput("{}: {}: expected at most 4096 bytes of text, found {}", name, field,
                       asShown(value));
        return value.get<std::string>();
    };
    const auto words = [&](const char* field) { return wordsIn(member(field), field); };
    // Earlier versions did not write all of these.
    const auto truth = [&](const char* field, bool missing) {
        if (!document.contains(field)) return missing;
        if (!document[field].is_boolean())
            throwInput("{}: {}: expected true or false, found {}", name, field,
                       asShown(document[field]));
        return document[field].get<bool>();
    };
    Session session;
    session.avatar = words("avatar");
    session.motion = words("motion");
    session.frames = words("frames");
    session.saved = words("saved");
    session.when = words("when");
    session.time = number(member("time"), name + ": time", 0, kLargestTime);
    session.edited = truth("edited", true);
    if (document.contains("worn")) {
        const json& worn = document["worn"];
        constexpr size_t kMostWorn = 100;
        if (!worn.is_object() || worn.size() > kMostWorn)
            throwInput("{}: worn: expected avatars by the names of parts, found {}", name,
                       worn.is_object() ? std::to_string(worn.size()) : asShown(worn));
        for (const auto& [part, avatar] : worn.items())
            session.worn[part] = wordsIn(avatar, "worn: " + part);
    }
    Take& take = session.take;
    take.layer.fade = number(member("fade"), name + ": fade", 0, kLongestFade);
    if (truth("overrides", false)) take.layer.blend = Layer::Blend::Override;
    take.betas = betasOf(member("betas"), name + ": betas");
    take.pose = poseIn(member("pose"), name + ": pose");
    const json& keys = member("keys");
    if (!keys.is_array() || keys.size() > kMostKeys)
        throwInput("{}: keys: expected a list of at most {}, found {}", name, kMostKeys,
                   keys.is_array() ? std::to_string(keys.size()) : asShown(keys));
    for (size_t i = 0; i < keys.size(); ++i) {
        const std::string field = fmt::format("{}: keys: {}", name, i);
        Keyframe key{0, poseIn(keys[i], field)};
        if (!keys[i].contains("time")) throwInput("{}: time: it is missing", field);
        key.time = number(keys[i]["time"], field + ": time", -kLargestTime, kLargestTime);
        if (i > 0 && !(key.time > take.keys.back().time + kSameTime))
            throwInput("{}: time: expected growing times, found {} after {}", field, key.time,
                       take.keys.back().time);
        take.keys.push_back(key);
    }
    return session;
}

}  // namespace doppel
