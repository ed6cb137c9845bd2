// EasyMocap (Dong et al.): a folder with a JSON file per picture, the people's Rh, Th, poses and
// shapes in a world; and where they lie beside it, the world's cameras in OpenCV's YAML (intri.yml,
// extri.yml).
#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/ending.h"
#include "engine/files/json_depth.h"
#include "engine/files/printable.h"
#include "trainer/data/frame_selection.h"
#include "trainer/motion/estimates/fields.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

constexpr uint64_t kMostBytes = uint64_t{64} << 20;  // of one file
constexpr size_t kMostFiles = 1'000'000;
// Studios have hundreds of cameras, with a dozen matrices each.
constexpr size_t kMostMatrices = 8192, kLongestName = 64;
constexpr size_t kMostViews = size_t{1} << 23;  // of all poses by all cameras

// ---- cameras ------------------------------------------------------------------------------------

struct WorldCamera {
    std::string name;
    double focal = 0;
    glm::dvec2 principal{0};
    glm::dmat3 rotation{1};
    glm::dvec3 translation{0};
};

// The matrices of a file of OpenCV's FileStorage, by name.
std::map<std::string, std::vector<double>> readMatrices(const fs::path& file) {
    const std::vector<uint8_t> bytes = readWholeFile(file, kMostBytes);
    const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    constexpr std::string_view kMatrix = ": !!opencv-matrix";
    std::map<std::string, std::vector<double>> matrices;
    for (size_t at = text.find(kMatrix); at != std::string_view::npos;
         at = text.find(kMatrix, at + 1)) {
        const std::string_view before = text.substr(at > kLongestName ? at - kLongestName - 1 : 0,
                                                    std::min(at, kLongestName + 1));
        const std::string name(before.substr(before.rfind('\n') + 1));
        if (name.size() > kLongestName || matrices.size() == kMostMatrices)
            throwInput(
                "{}: expected at most {} matrices with names of at most {} characters, found "
                "more",
                file.string(), kMostMatrices, kLongestName);
        const size_t begin = text.find("data:", at), open = text.find('[', begin),
                     end = text.find(']', open);
        if (end == std::string_view::npos || end > text.find(kMatrix, at + 1))
            throwInput("{}: {}: expected data: [ … ], found none", file.string(), printable(name));
        std::vector<double> numbers;
        for (size_t i = open + 1; i < end;) {
            const char c = text[i];
            if (c == ',' || c == ' ' || c == '\n' || c == '\r' || c == '\t') {
                ++i;
                continue;
            }
            double value = 0;
            const auto [rest, error] = std::from_chars(&text[i], text.data() + end, value);
            if (error != std::errc() || !std::isfinite(value) || std::abs(value) > 1e9)
                throwInput("{}: {}: expected numbers, found \"{}\"", file.string(), printable(name),
                           printable(text.substr(i, std::min(end - i, size_t{20}))));
            numbers.push_back(value);
            i = static_cast<size_t>(rest - text.data());
        }
        matrices[name] = std::move(numbers);
    }
    return matrices;
}

// Beside the folder, or up to three folders above it.
std::vector<WorldCamera> readWorldCameras(const fs::path& folder) {
    fs::path place = fs::absolute(folder).lexically_normal();
    std::error_code error;
    for (int up = 0; up < 4; ++up, place = place.parent_path()) {
        if (!fs::exists(place / "intri.yml", error) || !fs::exists(place / "extri.yml", error))
            continue;
        const fs::path file = place / "intri.yml", other = place / "extri.yml";
        const auto intri = readMatrices(file), extri = readMatrices(other);
        std::vector<WorldCamera> cameras;
        for (const auto& [key, k] : intri) {
            if (!key.starts_with("K_")) continue;
            WorldCamera camera;
            camera.name = key.substr(2);
            const auto numbers = [&](const std::string& name, size_t count) {
                const auto found = extri.find(name);
                if (found == extri.end() || found->second.size() != count)
                    throwInput("{}: expected {} with {} numbers, found {}", other.string(),
                               printable(name), count,
                               found == extri.end() ? "none" : "another number of them");
                return found->second;
            };
            if (k.size() != 9 || !(k[0] > 0))
                throwInput("{}: {}: expected a camera's matrix of 9 numbers, found {}",
                           file.string(), printable(key), k.size());
            camera.focal = (k[0] + k[4]) / 2;
            camera.principal = {k[2], k[5]};
            if (extri.contains("Rot_" + camera.name)) {
                const auto m = numbers("Rot_" + camera.name, 9);
                camera.rotation = glm::dmat3(m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]);
            } else {
                const auto r = numbers("R_" + camera.name, 3);
                camera.rotation = glm::mat3_cast(quaternionOf({r[0], r[1], r[2]}));
            }
            if (std::abs(glm::determinant(camera.rotation) - 1) > .05)
                throwInput("{}: Rot_{}: expected a rotation, found another matrix", other.string(),
                           printable(camera.name));
            const auto t = numbers("T_" + camera.name, 3);
            camera.translation = {t[0], t[1], t[2]};
            cameras.push_back(std::move(camera));
        }
        return cameras;
    }
    return {};
}

// ---- people -------------------------------------------------------------------------------------

std::vector<fs::path> filesOf(const fs::path& folder) {
    std::vector<fs::path> files;
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error))
        if (endingOf(entry.path()) == ".json" &&
            std::ranges::all_of(entry.path().stem().string(),
                                [](char c) { return c >= '0' && c <= '9'; }))
            files.push_back(entry.path());
    std::ranges::sort(files, [](const fs::path& a, const fs::path& b) {
        return naturallyBefore(a.filename().string(), b.filename().string());
    });
    return files;
}

// The folder itself, or smpl/ or smplx/ in it.
fs::path placeOf(const fs::path& folder) {
    for (const char* name : {"", "smpl", "smplx", "smplh"}) {
        const fs::path place = *name != '\0' ? folder / name : folder;
        if (!filesOf(place).empty()) return place;
    }
    return {};
}

nlohmann::json readJson(const fs::path& file) {
    const std::vector<uint8_t> bytes = readWholeFile(file, kMostBytes);
    requireShallowJson({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, file.string());
    auto json = nlohmann::json::parse(bytes.begin(), bytes.end(), nullptr, false);
    if (json.is_discarded()) throwInput("{}: expected JSON, found other text", file.string());
    return json;
}

const nlohmann::json& peopleOf(const nlohmann::json& json, const fs::path& file) {
    const auto& list = json.is_object() && json.contains("annots") ? json["annots"] : json;
    if (!list.is_array())
        throwInput("{}: expected a list of people, found another value", file.string());
    return list;
}

// [[1, 2, …]] or [1, 2, …]: of one person.
std::vector<double> numbersOf(const nlohmann::json& person, const char* name,
                              const std::string& where, size_t least) {
    const std::string what = fmt::format("{}: {}", where, name);
    if (!person.is_object() || !person.contains(name))
        throwInput("{}: expected {} numbers, found none", what, least);
    const nlohmann::json& rows = person[name];
    const auto& list = rows.is_array() && rows.size() == 1 && rows[0].is_array() ? rows[0] : rows;
    std::vector<double> numbers;
    if (list.is_array() && list.size() <= 4096)
        for (const auto& value : list) {
            if (!value.is_number())
                throwInput("{}: expected numbers, found {}", what, value.type_name());
            numbers.push_back(value.get<double>());
            if (!std::isfinite(numbers.back()) || std::abs(numbers.back()) > kMostMetres)
                throwInput("{}: expected finite numbers, found {}", what, numbers.back());
        }
    if (numbers.size() < least)
        throwInput("{}: expected {} numbers, found {}", what, least, numbers.size());
    return numbers;
}

void readEasyMocap(EstimateSource& source, Estimates& estimates) {
    const fs::path folder = placeOf(source.path);
    const auto files = filesOf(folder);
    if (files.size() > kMostFiles)
        throwInput("{}: expected at most {} files, found {}", folder.string(), kMostFiles,
                   files.size());
    const auto cameras = readWorldCameras(source.path);
    if (cameras.empty()) {
        // What EasyMocap takes for a single camera that nobody calibrated.
        estimates.readings = {"a focal length of 1.2 times the shorter side",
                              "a focal length of 1.2 times the longer side"};
    }
    for (const WorldCamera& camera : cameras)
        estimates.readings.push_back("the camera " + printable(camera.name));
    std::map<int64_t, EstimatedPerson> people;
    size_t views = 0;
    for (const fs::path& file : files) {
        const std::string stem = file.stem().string(), where = file.string();
        if (stem.size() > 9)
            throwInput("{}: expected the picture's number as the file's name, found {}", where,
                       printable(stem));
        const nlohmann::json json = readJson(file);
        for (const auto& person : peopleOf(json, file)) {
            const auto rh = numbersOf(person, "Rh", where, 3),
                       th = numbersOf(person, "Th", where, 3);
            const auto poses = numbersOf(person, "poses", where, 66);
            const auto id = person.find("id");
            if (id == person.end() || !id->is_number_integer())
                throwInput("{}: id: expected a person's number, found none", where);
            // 69: SMPL's without the pelvis; more than 72: SMPL-X's, hands behind its 21 joints.
            const size_t skipped = poses.size() == 69 ? 0 : 3;
            const size_t joints = poses.size() <= 72 ? (poses.size() - skipped) / 3 : 21;
            views += estimates.readings.size();
            if (views > kMostViews)
                throwInput("{}: expected at most {} poses, seen by {} cameras, found more", where,
                           kMostViews / estimates.readings.size(), estimates.readings.size());
            EstimatedPose pose;
            pose.picture = std::stoll(stem);
            pose.name = stem;
            const auto vectorAt = [](const std::vector<double>& v, size_t i) {
                return glm::dvec3(v[i], v[i + 1], v[i + 2]);
            };
            const glm::dquat turn = quaternionOf(vectorAt(rh, 0));
            glm::dquat root = turn;
            if (skipped > 0) root = root * quaternionOf(vectorAt(poses, 0));
            setJointRotation(pose.theta, joint::kPelvis, root);
            for (size_t j = 0; j < joints; ++j)
                setJointRotation(pose.theta, j + 1, quaternionOf(vectorAt(poses, skipped + 3 * j)));
            // Rh turns about the world's origin, not about the pelvis.
            const glm::dvec3 rest = poses.size() > 72 ? smplxPelvis() : restPelvis();
            const glm::dvec3 pelvis = turn * rest + vectorAt(th, 0);
            for (const WorldCamera& camera : cameras) {
                EstimatedView view;
                view.kind = EstimatedView::Kind::Metres;
                view.turn = glm::normalize(glm::quat_cast(camera.rotation));
                view.pelvis = camera.rotation * pelvis + camera.translation;
                view.of = EstimatedView::Focal::Pixels;
                view.focal = camera.focal;
                view.principal = camera.principal;
                pose.views.push_back(view);
            }
            for (const bool longer : {false, true}) {
                if (!cameras.empty()) break;
                EstimatedView view;
                view.kind = EstimatedView::Kind::Metres;
                view.pelvis = pelvis;
                view.of = longer ? EstimatedView::Focal::Longest : EstimatedView::Focal::Shortest;
                view.focal = 1.2;
                pose.views.push_back(view);
            }
            auto& world = pose.world.emplace();
            world.theta = pose.theta;
            for (int c = 0; c < 3; ++c)
                world.trans[static_cast<size_t>(c)] =
                    static_cast<float>(pelvis[c] - restPelvis()[c]);
            people[id->get<int64_t>()].poses.push_back(std::move(pose));
        }
    }
    for (auto& [id, person] : people) {
        person.name = std::to_string(id);
        estimates.people.push_back(std::move(person));
    }
    if (estimates.people.empty())
        throwInput("{}: expected one person or more, found nobody in {} files", folder.string(),
                   files.size());
}

const EstimateFormat kEasyMocap{{
    .program = "EasyMocap",
    .looks = "a folder of EasyMocap's JSON (000000.json, …)",
    .measured = true,
    .recognises =
        [](const EstimateSource& source) {
            if (!source.folder) return false;
            const fs::path folder = placeOf(source.path);
            if (folder.empty()) return false;
            // In the first pictures there may be nobody.
            const auto files = filesOf(folder);
            for (size_t i = 0; i < std::min<size_t>(files.size(), 100); ++i) {
                const nlohmann::json json = readJson(files[i]);
                const nlohmann::json& people = peopleOf(json, files[i]);
                if (people.empty()) continue;
                return people[0].is_object() && people[0].contains("Rh") &&
                       people[0].contains("Th");
            }
            return false;
        },
    .read = readEasyMocap,
}};

}  // namespace

}  // namespace doppel
