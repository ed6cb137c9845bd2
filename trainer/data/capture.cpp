#include "trainer/data/capture.h"

#include <fmt/ranges.h>

#include <toml++/toml.h>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>
#include <sstream>

#include "engine/atomic_file.h"
#include "engine/error.h"
#include "engine/io/image.h"
#include "engine/npz.h"
#include "trainer/motion/bvh.h"
#include "trainer/motion/joints.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

using Vec3 = std::array<double, 3>;
using Mat3 = std::array<Vec3, 3>;

constexpr Vec3 kPelvis = kRestPelvis;
constexpr int kSmplJoints = 24;

// ---- rotations ----------------------------------------------------------------------------------

Mat3 multiply(const Mat3& a, const Mat3& b) {
    Mat3 c{};
    for (size_t i = 0; i < 3; ++i) {
        for (size_t j = 0; j < 3; ++j) {
            for (size_t k = 0; k < 3; ++k) c[i][j] += a[i][k] * b[k][j];
        }
    }
    return c;
}

Vec3 multiply(const Mat3& a, const Vec3& v) {
    Vec3 r{};
    for (size_t i = 0; i < 3; ++i) r[i] = a[i][0] * v[0] + a[i][1] * v[1] + a[i][2] * v[2];
    return r;
}

Mat3 rotationOf(const Vec3& axisAngle) {
    const double angle = std::hypot(axisAngle[0], axisAngle[1], axisAngle[2]);
    // sin(a)/a and (1 − cos a)/a², whose limits at 0 are 1 and a half.
    const double s = angle > 1e-8 ? std::sin(angle) / angle : 1;
    const double c = angle > 1e-8 ? (1 - std::cos(angle)) / (angle * angle) : .5;
    const auto [x, y, z] = axisAngle;
    return {{{1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y},
             {c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x},
             {c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y)}}};
}

// By way of the quaternion, which is exact near a half turn, where people before a camera whose y
// points down always are.
Vec3 axisAngleOf(const Mat3& r) {
    const double trace = r[0][0] + r[1][1] + r[2][2];
    const std::array<double, 4> squares{1 + trace, 1 + 2 * r[0][0] - trace, 1 + 2 * r[1][1] - trace,
                                        1 + 2 * r[2][2] - trace};  // 4w², 4x², 4y², 4z²
    const auto largest =
        static_cast<size_t>(std::max_element(squares.begin(), squares.end()) - squares.begin());
    const double d = 2 * std::sqrt(squares[largest]);
    std::array<double, 4> q{};  // w, x, y, z
    if (largest == 0) {
        q = {d / 4, (r[2][1] - r[1][2]) / d, (r[0][2] - r[2][0]) / d, (r[1][0] - r[0][1]) / d};
    } else {
        const size_t i = largest - 1, j = (i + 1) % 3, k = (i + 2) % 3;
        q[0] = (r[k][j] - r[j][k]) / d;
        q[1 + i] = d / 4;
        q[1 + j] = (r[i][j] + r[j][i]) / d;
        q[1 + k] = (r[i][k] + r[k][i]) / d;
    }
    if (q[0] < 0) {
        for (double& value : q) value = -value;
    }
    const double sine = std::hypot(q[1], q[2], q[3]);
    const double scale = sine > 1e-12 ? 2 * std::atan2(sine, q[0]) / sine : 2;
    return {q[1] * scale, q[2] * scale, q[3] * scale};
}

struct Rigid {
    Mat3 rotation{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    Vec3 translation{};
    bool operator==(const Rigid&) const = default;
};

// v_cam = R(θ0)(v − j0) + j0 + t, moved on by x → A x + b.
void movePose(const Rigid& by, Theta& theta, Trans& trans) {
    if (by == Rigid{}) return;
    const Vec3 turn =
        axisAngleOf(multiply(by.rotation, rotationOf({theta[0], theta[1], theta[2]})));
    const Vec3 at = multiply(
        by.rotation, Vec3{kPelvis[0] + trans[0], kPelvis[1] + trans[1], kPelvis[2] + trans[2]});
    for (size_t i = 0; i < 3; ++i) {
        theta[i] = static_cast<float>(turn[i]);
        trans[i] = static_cast<float>(at[i] + by.translation[i] - kPelvis[i]);
    }
}

// ---- names --------------------------------------------------------------------------------------

bool isPictureName(const fs::path& path) {
    std::string extension = path.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return extension == ".png" || extension == ".jpg" || extension == ".jpeg";
}

// Pictures of a folder by their names without extension.
std::map<std::string, fs::path> picturesIn(const fs::path& folder) {
    std::map<std::string, fs::path> pictures;
    std::error_code error;
    fs::directory_iterator entries(folder, error);
    if (error) throwInput("{}: cannot be read: {}", folder.string(), error.message());
    for (const auto& entry : entries) {
        const fs::path& path = entry.path();
        if (!isPictureName(path) || path.filename().string().starts_with('.')) continue;
        const auto [at, added] = pictures.emplace(path.stem().string(), path);
        if (!added) {
            throwInput("{}: expected one picture of this name, found {} too", path.string(),
                       at->second.filename().string());
        }
    }
    return pictures;
}

// ---- files --------------------------------------------------------------------------------------

// Beyond these a number is a mistake, and single precision leaves nothing of the body.
constexpr double kMostMetres = 1e6, kMostRadians = 1e4, kMostDeviations = 1e3, kMostPixels = 1e7;

void requireFinite(std::span<const float> values, const std::string& what, size_t perFrame,
                   double most = std::numeric_limits<double>::infinity()) {
    for (size_t i = 0; i < values.size(); ++i) {
        if (!std::isfinite(values[i])) {
            throwInput("{}: expected finite numbers, found {} in frame {}, element {}", what,
                       values[i], i / perFrame, i % perFrame);
        }
        if (std::abs(double(values[i])) > most) {
            throwInput("{}: expected numbers from {} to {}, found {} in frame {}, element {}", what,
                       -most, most, values[i], i / perFrame, i % perFrame);
        }
    }
}

struct Poses {
    Betas betas{};
    std::vector<Theta> theta;
    std::vector<Trans> trans;
    std::optional<double> fps;
};

Poses readPoses(const fs::path& path, bool needBetas) {
    const Npz npz = readNpz(path);
    const auto orient = npz.at("global_orient").requireShape({-1, 3}).toF32();
    const auto body = npz.at("body_pose").requireShape({-1, 69}).toF32();
    const auto transl = npz.at("transl").requireShape({-1, 3}).toF32();
    const auto file = path.string();
    requireFinite(orient, file + ": global_orient", 3, kMostRadians);
    requireFinite(body, file + ": body_pose", 69, kMostRadians);
    requireFinite(transl, file + ": transl", 3, kMostMetres);
    const size_t frames = orient.size() / 3;
    if (frames == 0) throwInput("{}: global_orient: expected one frame or more, found none", file);
    if (body.size() / 69 != frames) {
        throwInput("{}: body_pose: expected {} rows, as many as global_orient has, found {}", file,
                   frames, body.size() / 69);
    }
    if (transl.size() / 3 != frames) {
        throwInput("{}: transl: expected {} rows, as many as global_orient has, found {}", file,
                   frames, transl.size() / 3);
    }
    Poses poses;
    poses.theta.resize(frames);
    poses.trans.resize(frames);
    for (size_t f = 0; f < frames; ++f) {
        std::copy_n(orient.begin() + std::ptrdiff_t(3 * f), 3, poses.theta[f].begin());
        std::copy_n(body.begin() + std::ptrdiff_t(69 * f), 69, poses.theta[f].begin() + 3);
        std::copy_n(transl.begin() + std::ptrdiff_t(3 * f), 3, poses.trans[f].begin());
    }
    if (needBetas || npz.has("betas")) {
        const Array& array = npz.at("betas");
        // Some programs write [1, 10].
        if (array.shape != std::vector<int64_t>{1, 10}) array.requireShape({10});
        const auto betas = array.toF32();
        requireFinite(betas, file + ": betas", 10, kMostDeviations);
        std::copy(betas.begin(), betas.end(), poses.betas.begin());
    }
    if (const Array* fps = npz.find("fps")) poses.fps = fps->scalar();
    return poses;
}

// One value, or one per frame.
std::vector<int64_t> perFrame(const Array& array, size_t frames, const std::string& what) {
    std::vector<int64_t> values =
        array.isFloat() ? std::vector<int64_t>{array.integer()} : array.toI64();
    if (values.size() == 1) values.resize(frames, values[0]);
    if (values.size() != frames) {
        throwInput("{}: expected one number or one per frame ({}), found {}", what, frames,
                   values.size());
    }
    return values;
}

// Matrices [rows, rows] or [F, rows, rows], as one per frame.
std::vector<std::vector<double>> matrices(const Array& array, int64_t rows, size_t frames,
                                          const std::string& what) {
    if (array.shape.size() == 2) {
        array.requireShape({rows, rows});
    } else {
        array.requireShape({-1, rows, rows});
    }
    const std::vector<double> values = array.toF64();
    const auto size = static_cast<size_t>(rows * rows);
    const size_t count = values.size() / size;
    if (array.shape.size() == 3 && count != frames) {
        throwInput("{}: expected one matrix or one per frame ({}), found {}", what, frames, count);
    }
    for (double value : values) {
        if (!std::isfinite(value)) {
            throwInput("{}: expected finite numbers, found {}", what, value);
        }
    }
    std::vector<std::vector<double>> result(frames);
    for (size_t f = 0; f < frames; ++f) {
        const size_t at = array.shape.size() == 3 ? f * size : 0;
        result[f].assign(values.begin() + std::ptrdiff_t(at),
                         values.begin() + std::ptrdiff_t(at + size));
    }
    return result;
}

Rigid rigidOf(const std::vector<double>& m, const std::string& what) {
    Rigid rigid;
    double worst = std::abs(m[12]) + std::abs(m[13]) + std::abs(m[14]) + std::abs(m[15] - 1);
    for (size_t i = 0; i < 3; ++i) {
        rigid.rotation[i] = {m[4 * i], m[4 * i + 1], m[4 * i + 2]};
        rigid.translation[i] = m[4 * i + 3];
    }
    const Mat3& r = rigid.rotation;
    for (size_t i = 0; i < 3; ++i) {
        for (size_t j = 0; j < 3; ++j) {
            const double dot = r[i][0] * r[j][0] + r[i][1] * r[j][1] + r[i][2] * r[j][2];
            worst = std::max(worst, std::abs(dot - (i == j)));
        }
    }
    const double determinant = r[0][0] * (r[1][1] * r[2][2] - r[1][2] * r[2][1]) -
                               r[0][1] * (r[1][0] * r[2][2] - r[1][2] * r[2][0]) +
                               r[0][2] * (r[1][0] * r[2][1] - r[1][1] * r[2][0]);
    if (worst > 1e-3 || determinant < 0) {
        throwInput(
            "{}: expected a rotation and a translation (world to camera), found a matrix "
            "that is none",
            what);
    }
    return rigid;
}

struct Cameras {
    std::vector<Camera> cameras;
    std::vector<Rigid> extrinsics;
};

Cameras readCameras(const fs::path& path, size_t frames) {
    const Npz npz = readNpz(path);
    const std::string file = path.string();
    const auto widths = perFrame(npz.at("width"), frames, file + ": width");
    const auto heights = perFrame(npz.at("height"), frames, file + ": height");
    const auto intrinsics = matrices(npz.at("intrinsic"), 3, frames, file + ": intrinsic");
    Cameras result;
    for (size_t f = 0; f < frames; ++f) {
        const auto& m = intrinsics[f];
        if (widths[f] < 1 || heights[f] < 1 || widths[f] > kMaxImageSide ||
            heights[f] > kMaxImageSide) {
            throwInput("{}: width, height: expected 1 to {} pixels, found {}×{}", file,
                       kMaxImageSide, widths[f], heights[f]);
        }
        if (m[0] <= 0 || m[4] <= 0 || m[1] != 0 || m[3] != 0 || m[6] != 0 || m[7] != 0 ||
            m[8] != 1) {
            throwInput(
                "{}: intrinsic: expected [fx 0 cx; 0 fy cy; 0 0 1] with positive focal "
                "lengths, found [{}; {}; {}]",
                file, fmt::join(m.begin(), m.begin() + 3, " "),
                fmt::join(m.begin() + 3, m.begin() + 6, " "),
                fmt::join(m.begin() + 6, m.end(), " "));
        }
        for (size_t i : {0u, 2u, 4u, 5u}) {
            if (std::abs(m[i]) <= kMostPixels) continue;
            throwInput("{}: intrinsic: expected numbers from {} to {}, found {} in frame {}", file,
                       -kMostPixels, kMostPixels, m[i], f);
        }
        result.cameras.push_back({m[0], m[4], m[2], m[5], int(widths[f]), int(heights[f])});
    }
    result.extrinsics.resize(frames);
    if (const Array* extrinsic = npz.find("extrinsic")) {
        const auto values = matrices(*extrinsic, 4, frames, file + ": extrinsic");
        for (size_t f = 0; f < frames; ++f) {
            result.extrinsics[f] = rigidOf(values[f], file + ": extrinsic");
            for (double metres : result.extrinsics[f].translation) {
                if (std::abs(metres) <= kMostMetres) continue;
                throwInput(
                    "{}: extrinsic: expected a translation from {} to {} m, found {} in "
                    "frame {}",
                    file, -kMostMetres, kMostMetres, metres, f);
            }
        }
    }
    return result;
}

struct Notes {
    std::string name;
    double fps = 30;
    std::string actor, motion;
    std::vector<std::string> frames;  // empty: not listed
    std::string scheme;
    std::map<std::string, std::string> source;
    std::optional<Betas> sourceBetas;
};

double checkedFps(double fps, const std::string& what) {
    if (!(fps > 0) || !(fps <= 10000)) {
        throwInput("{}: expected frames per second, from 0 to 10000, found {}", what, fps);
    }
    return fps;
}

Notes readNotes(const fs::path& folder) {
    Notes notes;
    const fs::path absolute = fs::absolute(folder).lexically_normal();
    notes.name = (absolute.has_filename() ? absolute : absolute.parent_path()).filename().string();
    const fs::path path = folder / "capture.toml";
    std::error_code error;
    if (!fs::exists(path, error)) return notes;
    const std::string file = path.string();
    const std::vector<uint8_t> bytes = readWholeFile(path, uint64_t{64} << 20);
    toml::table table;
    try {
        table = toml::parse(
            std::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()), file);
    } catch (const toml::parse_error& problem) {
        throwInput("{}: line {}: not TOML: {}", file, problem.source().begin.line,
                   problem.description());
    }
    for (const auto& [key, text] :
         {std::pair{"name", &notes.name}, {"actor", &notes.actor}, {"motion", &notes.motion}}) {
        const auto* node = table.get(key);
        if (node == nullptr) continue;
        if (!node->is_string()) throwInput("{}: {}: expected a text", file, key);
        *text = **node->as_string();
        // Folders of results are named after these two; an empty one says nothing.
        if (text != &notes.name && !text->empty()) requireFileName(*text, file + ": " + key);
    }
    if (const auto* node = table.get("fps")) {
        const auto fps = node->value<double>();
        if (!fps) throwInput("{}: fps: expected a number", file);
        notes.fps = checkedFps(*fps, file + ": fps");
    }
    if (const auto* node = table.get("frames")) {
        const auto* list = node->as_array();
        if (list == nullptr) throwInput("{}: frames: expected a list of names", file);
        std::set<std::string> seen;
        for (const toml::node& element : *list) {
            const auto name = element.value<std::string>();
            if (!element.is_string()) {
                throwInput("{}: frames: expected names of pictures, found something else", file);
            }
            requireFileName(*name, file + ": frames");
            if (!seen.insert(*name).second) {
                throwInput("{}: frames: expected each name once, found \"{}\" twice", file, *name);
            }
            notes.frames.push_back(*name);
        }
        if (notes.frames.empty()) {
            throwInput("{}: frames: expected one name or more, found none", file);
        }
    }
    if (const auto scheme = table["keypoints"]["scheme"].value<std::string>()) {
        notes.scheme = *scheme;
    }
    if (const auto* source = table["source"].as_table()) {
        for (const auto& [key, node] : *source) {
            if (key == "betas" && node.is_array() && node.as_array()->size() == 10) {
                notes.sourceBetas.emplace();
                for (size_t i = 0; i < 10; ++i) {
                    (*notes.sourceBetas)[i] = node.as_array()->get(i)->value_or(0.f);
                }
            } else if (const auto text = node.value<std::string>()) {
                notes.source.emplace(std::string(key.str()), *text);
            }
        }
    }
    return notes;
}

Keypoints readKeypoints(const fs::path& path, std::string scheme, size_t frames) {
    const Array array = readNpy(path);
    const std::string file = path.string();
    array.requireShape({-1, -1, 3}, file);
    if (array.shape[0] != int64_t(frames)) {
        throwInput("{}: expected {} frames, as images/ has, found {}", file, frames,
                   array.shape[0]);
    }
    const int64_t count = array.shape[1];
    if (scheme.empty() && count == 25) scheme = "openpose25";
    if (scheme.empty() && count == 19) scheme = "lsp19";
    if (scheme.empty()) {
        throwInput(
            "{}: expected 25 keypoints (openpose25) or 19 (lsp19), or [keypoints] scheme in "
            "capture.toml, found {}",
            file, count);
    }
    if (int64_t(keypointJoints(scheme).size()) != count) {
        throwInput("{}: expected {} keypoints for the scheme {}, found {}", file,
                   keypointJoints(scheme).size(), scheme, count);
    }
    Keypoints keypoints{std::move(scheme), int(count), array.toF32()};
    requireFinite(keypoints.values, file, size_t(3 * count));
    return keypoints;
}

void requireFolder(const fs::path& folder, const char* what) {
    std::error_code error;
    if (fs::is_directory(folder, error)) return;
    throwInput("{}: expected {}, found {}", folder.string(), what,
               fs::exists(folder, error) ? "a file" : "nothing");
}

void requireSize(const fs::path& path, const Camera& camera, const char* of) {
    const ImageSize size = imageSize(path);
    if (size.width == camera.width && size.height == camera.height) return;
    throwInput("{}: expected {}×{} pixels, the size of {}, found {}×{}", path.string(),
               camera.width, camera.height, of, size.width, size.height);
}

// One row of the table from output pixels to source pixels along one axis.
struct Taps {
    int first = 0;
    std::vector<double> weights;  // sum 1; empty: nothing of the pixel is inside
    double inside = 0;            // part of the pixel's length that lies inside
};

std::vector<Taps> tapsOf(double begin, double step, int count, int length) {
    std::vector<Taps> taps(static_cast<size_t>(count));
    for (int i = 0; i < count; ++i) {
        Taps& t = taps[size_t(i)];
        const double from = begin + i * step, to = from + step;
        const double low = std::max(from, 0.), high = std::min(to, double(length));
        if (high <= low) continue;
        t.inside = (high - low) / step;
        if (step >= 1) {
            t.first = std::min(int(low), length - 1);
            const int last = std::min(int(std::ceil(high)), length);
            for (int s = t.first; s < last; ++s) {
                const double overlap = std::min(high, s + 1.) - std::max(low, double(s));
                t.weights.push_back(overlap / (high - low));
            }
        } else {
            const double centre = std::clamp((from + to) / 2 - .5, 0., double(length - 1));
            t.first = std::min(int(centre), std::max(length - 2, 0));
            const double part = centre - t.first;
            t.weights = {1 - part};
            if (length > 1) t.weights.push_back(part);
        }
    }
    return taps;
}

// channels interleaved; result [size][size][channels], in [0,1].
std::vector<float> resample(std::span<const uint8_t> source, int width, size_t channels,
                            const std::vector<Taps>& columns, const std::vector<Taps>& rows) {
    const size_t outWidth = columns.size(), rowSize = size_t(width) * channels;
    std::vector<float> result(outWidth * rows.size() * channels, 0.f);
    // Rows of the source, already resampled along x, as they are needed: rows' taps only move down.
    std::map<int, std::vector<double>> ready;
    std::vector<double> sum(outWidth * channels);
    for (size_t y = 0; y < rows.size(); ++y) {
        const Taps& row = rows[y];
        if (row.weights.empty()) continue;
        std::erase_if(ready, [&](const auto& entry) { return entry.first < row.first; });
        std::fill(sum.begin(), sum.end(), 0);
        for (size_t k = 0; k < row.weights.size(); ++k) {
            const int sourceY = row.first + int(k);
            auto& line = ready[sourceY];
            if (line.empty()) {
                line.assign(outWidth * channels, 0);
                const uint8_t* from = source.data() + size_t(sourceY) * rowSize;
                for (size_t x = 0; x < outWidth; ++x) {
                    const Taps& column = columns[x];
                    for (size_t j = 0; j < column.weights.size(); ++j) {
                        const uint8_t* pixel = from + (size_t(column.first) + j) * channels;
                        for (size_t c = 0; c < channels; ++c) {
                            line[x * channels + c] += column.weights[j] * pixel[c];
                        }
                    }
                }
            }
            for (size_t i = 0; i < sum.size(); ++i) sum[i] += row.weights[k] * line[i];
        }
        for (size_t i = 0; i < sum.size(); ++i) {
            result[y * outWidth * channels + i] = static_cast<float>(sum[i] / 255);
        }
    }
    return result;
}

}  // namespace

// ---- keypoints ----------------------------------------------------------------------------------

std::span<const int> keypointJoints(std::string_view scheme) {
    // BODY_25: nose, neck, right shoulder elbow wrist, left shoulder elbow wrist, mid hip, right
    // hip knee ankle, left hip knee ankle, eyes, ears, left big toe, small toe, heel, right ones.
    static constexpr std::array<int, 25> openpose25{-1, -1, 17, 19, 21, 16, 18, 20, -1,
                                                    2,  5,  8,  1,  4,  7,  -1, -1, -1,
                                                    -1, -1, -1, -1, -1, -1, -1};
    // LSP's 14: right ankle knee hip, left hip knee ankle, right wrist elbow shoulder, left
    // shoulder elbow wrist, neck, top of the head; then nose, eyes, ears.
    static constexpr std::array<int, 19> lsp19{8,  5,  2,  1,  4,  7,  21, 19, 17, 16,
                                               18, 20, -1, -1, -1, -1, -1, -1, -1};
    if (scheme == "openpose25") return openpose25;
    if (scheme == "lsp19") return lsp19;
    throwInput("keypoints: expected the scheme openpose25 or lsp19, found \"{}\"", scheme);
}

// ---- captures -----------------------------------------------------------------------------------

bool Capture::hasMasks() const {
    return !frames.empty() && std::all_of(frames.begin(), frames.end(),
                                          [](const Frame& f) { return f.mask.has_value(); });
}

void Capture::requireMasks() const {
    for (const Frame& frame : frames) {
        if (frame.mask) continue;
        throwInput(
            "{}: expected a mask for every frame, found none for {}; bring them in with the "
            "source, or make them from a green screen with `doppel import --key`",
            (folder / "masks").string(), frame.name);
    }
}

Capture Capture::subset(std::span<const size_t> indices) const {
    Capture part;
    part.folder = folder;
    part.name = name;
    part.actor = actor;
    part.motion = motion;
    part.fps = fps;
    part.betas = betas;
    part.source = source;
    part.sourceBetas = sourceBetas;
    if (keypoints) part.keypoints = Keypoints{keypoints->scheme, keypoints->count, {}};
    for (size_t i : indices) {
        CHECK(i < frames.size(), "frame {} is one of the capture's {}", i, frames.size());
        part.frames.push_back(frames[i]);
        part.theta.push_back(theta[i]);
        part.trans.push_back(trans[i]);
        if (keypoints) {
            const auto size = std::ptrdiff_t(3 * keypoints->count);
            const auto from = keypoints->values.begin() + std::ptrdiff_t(i) * size;
            part.keypoints->values.insert(part.keypoints->values.end(), from, from + size);
        }
    }
    return part;
}

Capture readCapture(const fs::path& folder) {
    requireFolder(folder, "a capture's folder");
    requireFolder(folder / "images", "a capture's pictures");
    const Notes notes = readNotes(folder);
    const auto images = picturesIn(folder / "images");
    std::vector<std::string> names = notes.frames;
    if (names.empty()) {
        for (const auto& [name, path] : images) {
            requireFileName(name, (folder / "images").string());
            names.push_back(name);
        }
        std::sort(names.begin(), names.end(), naturallyBefore);
    }
    if (names.empty()) {
        throwInput("{}: expected one picture (.png, .jpg) or more, found none",
                   (folder / "images").string());
    }
    const Cameras cameras = readCameras(folder / "cameras.npz", names.size());
    std::error_code error;
    const bool masked = fs::exists(folder / "masks", error);
    const auto masks = masked ? picturesIn(folder / "masks") : std::map<std::string, fs::path>{};

    Capture capture;
    capture.folder = folder;
    capture.name = notes.name;
    capture.actor = notes.actor;
    capture.motion = notes.motion;
    capture.fps = notes.fps;
    capture.source = notes.source;
    capture.sourceBetas = notes.sourceBetas;
    for (size_t f = 0; f < names.size(); ++f) {
        Frame frame{names[f], {}, {}, cameras.cameras[f]};
        const auto image = images.find(names[f]);
        if (image == images.end()) {
            throwInput("{}: expected a picture for the frame {} of capture.toml, found none",
                       (folder / "images").string(), names[f]);
        }
        frame.image = image->second;
        requireSize(frame.image, frame.camera, "cameras.npz");
        if (masked) {
            const auto mask = masks.find(names[f]);
            if (mask == masks.end()) {
                throwInput("{}: expected a mask for every frame, found none for {}",
                           (folder / "masks").string(), names[f]);
            }
            frame.mask = mask->second;
            requireSize(*frame.mask, frame.camera, "its frame");
        }
        capture.frames.push_back(std::move(frame));
    }

    const fs::path posesPath = folder / "poses.npz";
    Poses poses = readPoses(posesPath, true);
    if (poses.theta.size() != names.size()) {
        throwInput("{}: global_orient: expected {} rows, as many as there are frames, found {}",
                   posesPath.string(), names.size(), poses.theta.size());
    }
    for (size_t f = 0; f < names.size(); ++f) {
        movePose(cameras.extrinsics[f], poses.theta[f], poses.trans[f]);
    }
    capture.betas = poses.betas;
    capture.theta = std::move(poses.theta);
    capture.trans = std::move(poses.trans);
    if (fs::exists(folder / "keypoints.npy", error)) {
        capture.keypoints = readKeypoints(folder / "keypoints.npy", notes.scheme, names.size());
    }
    return capture;
}

// ---- motions ------------------------------------------------------------------------------------

Motion Motion::subset(std::span<const size_t> indices) const {
    Motion part{source, name, fps, {}, {}, betas, {}};
    for (size_t i : indices) {
        CHECK(i < size(), "frame {} is one of the motion's {}", i, size());
        part.theta.push_back(theta[i]);
        part.trans.push_back(trans[i]);
        if (!cameras.empty()) part.cameras.push_back(cameras[i]);
    }
    return part;
}

Motion readMotion(const fs::path& path) {
    std::error_code error;
    if (!fs::exists(path, error)) {
        throwInput(
            "{}: expected a motion: a capture's folder, a poses.npz or a .bvh, found nothing",
            path.string());
    }
    std::string extension = path.extension().string();
    std::transform(extension.begin(), extension.end(), extension.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    if (extension == ".bvh" && !fs::is_directory(path, error)) return motionFromBvh(readBvh(path));
    Motion motion;
    motion.source = path;
    const bool isFolder = fs::is_directory(path, error);
    Poses poses = readPoses(isFolder ? path / "poses.npz" : path, false);
    if (isFolder) {
        const Notes notes = readNotes(path);
        motion.name = notes.name;
        motion.fps = notes.fps;
        if (!notes.frames.empty() && notes.frames.size() != poses.theta.size()) {
            throwInput(
                "{}: global_orient: expected {} rows, as many as capture.toml has frames, "
                "found {}",
                (path / "poses.npz").string(), notes.frames.size(), poses.theta.size());
        }
        if (fs::exists(path / "cameras.npz", error)) {
            Cameras cameras = readCameras(path / "cameras.npz", poses.theta.size());
            for (size_t f = 0; f < poses.theta.size(); ++f) {
                movePose(cameras.extrinsics[f], poses.theta[f], poses.trans[f]);
            }
            motion.cameras = std::move(cameras.cameras);
        }
    } else {
        motion.name = path.stem().string();
        if (poses.fps) motion.fps = checkedFps(*poses.fps, path.string() + ": fps");
    }
    motion.theta = std::move(poses.theta);
    motion.trans = std::move(poses.trans);
    motion.betas = poses.betas;
    return motion;
}

Motion throughCameras(Motion motion, const fs::path& path) {
    Cameras cameras = readCameras(path, motion.size());
    for (size_t f = 0; f < motion.size(); ++f)
        movePose(cameras.extrinsics[f], motion.theta[f], motion.trans[f]);
    motion.cameras = std::move(cameras.cameras);
    return motion;
}

// ---- names and selection ------------------------------------------------------------------------

bool naturallyBefore(const std::string& a, const std::string& b) {
    const auto digit = [](char c) { return c >= '0' && c <= '9'; };
    size_t i = 0, j = 0;
    while (i < a.size() && j < b.size()) {
        if (digit(a[i]) && digit(b[j])) {
            const auto run = [&](const std::string& s, size_t& at) {
                while (at < s.size() && s[at] == '0') ++at;
                const size_t begin = at;
                while (at < s.size() && digit(s[at])) ++at;
                return std::string_view(s).substr(begin, at - begin);
            };
            const std::string_view x = run(a, i), y = run(b, j);
            if (x.size() != y.size()) return x.size() < y.size();
            if (x != y) return x < y;
        } else {
            if (a[i] != b[j]) return a[i] < b[j];
            ++i, ++j;
        }
    }
    if (a.size() - i != b.size() - j) return a.size() - i < b.size() - j;
    return a < b;
}

std::vector<size_t> selectFrames(std::string_view text, size_t count, std::string_view what) {
    const auto wrong = [&] {
        throwInput(
            "{}: expected a:b, a:b:step, a frame's number, or a list of these with commas, "
            "found \"{}\"",
            what, text);
    };
    const auto total = static_cast<int64_t>(count);
    std::vector<bool> chosen(count, text.empty());
    size_t begin = 0;
    while (!text.empty() && begin <= text.size()) {
        const size_t comma = std::min(text.find(',', begin), text.size());
        std::string_view item = text.substr(begin, comma - begin);
        begin = comma + 1;
        // Up to three numbers between colons, each of which may be missing.
        std::vector<std::optional<int64_t>> numbers;
        while (true) {
            const size_t colon = std::min(item.find(':'), item.size());
            const std::string_view word = item.substr(0, colon);
            std::optional<int64_t> number;
            if (!word.empty()) {
                int64_t value = 0;
                const auto [end, error] =
                    std::from_chars(word.data(), word.data() + word.size(), value);
                if (error != std::errc() || end != word.data() + word.size()) wrong();
                number = value;
            }
            numbers.push_back(number);
            if (colon == item.size()) break;
            item.remove_prefix(colon + 1);
        }
        if (numbers.size() > 3 || (numbers.size() == 1 && !numbers[0])) wrong();
        const auto fromEnd = [&](int64_t i) { return i < 0 ? i + total : i; };
        if (numbers.size() == 1) {
            const int64_t i = fromEnd(*numbers[0]);
            if (i < 0 || i >= total) {
                throwInput("{}: expected a frame from 0 to {}, found {}", what, total - 1,
                           *numbers[0]);
            }
            chosen[size_t(i)] = true;
            continue;
        }
        const int64_t from = fromEnd(numbers[0].value_or(0));
        const int64_t to = fromEnd(numbers[1].value_or(total));
        const int64_t step = numbers.size() == 3 ? numbers[2].value_or(1) : 1;
        if (step < 1) throwInput("{}: expected a step of 1 or more, found {}", what, step);
        if (from < 0 || from > total || to < 0 || to > total) {
            throwInput("{}: expected frames within 0:{}, found \"{}\"", what, total, text);
        }
        for (int64_t i = from; i < to; i += step) chosen[size_t(i)] = true;
    }
    std::vector<size_t> indices;
    for (size_t i = 0; i < count; ++i) {
        if (chosen[i]) indices.push_back(i);
    }
    if (indices.empty()) {
        throwInput("{}: expected one frame or more of the {}, found none in \"{}\"", what, count,
                   text);
    }
    return indices;
}

// ---- pictures -----------------------------------------------------------------------------------

FrameCache::FrameCache(const Capture& capture, size_t memoryBudget)
    : capture_(capture), budget_(memoryBudget) {}

std::shared_ptr<const Picture> FrameCache::load(size_t index) {
    CHECK(index < capture_.size(), "frame {} is one of the capture's {}", index, capture_.size());
    {
        const std::lock_guard lock(mutex_);
        for (auto at = kept_.begin(); at != kept_.end(); ++at) {
            if (at->first != index) continue;
            kept_.splice(kept_.begin(), kept_, at);
            return at->second;
        }
    }
    // Decoded without the lock, so that threads decode side by side.
    const Frame& frame = capture_.frames[index];
    auto picture = std::make_shared<Picture>();
    Image image = readImage(frame.image, 3);
    const auto require = [&](const fs::path& path, const Image& read) {
        if (read.width == frame.camera.width && read.height == frame.camera.height) return;
        throwInput("{}: expected {}×{} pixels, found {}×{}", path.string(), frame.camera.width,
                   frame.camera.height, read.width, read.height);
    };
    require(frame.image, image);
    picture->width = image.width;
    picture->height = image.height;
    picture->rgb = std::move(image.data);
    if (frame.mask) {
        Image mask = readMask(*frame.mask);
        require(*frame.mask, mask);
        picture->mask = std::move(mask.data);
    }
    const std::lock_guard lock(mutex_);
    const auto bytesOf = [](const Picture& p) { return p.rgb.size() + p.mask.size(); };
    kept_.emplace_front(index, picture);
    used_ += bytesOf(*picture);
    // The newest stays, even where it alone is more than the budget.
    while (used_ > budget_ && kept_.size() > 1) {
        used_ -= bytesOf(*kept_.back().second);
        kept_.pop_back();
    }
    return picture;
}

CropBox cropBox(const Camera& camera, std::span<const std::array<double, 3>> joints,
                std::string_view where) {
    CHECK(joints.size() == kSmplJoints, "a body has 24 joints, not {}", joints.size());
    for (size_t j = 0; j < joints.size(); ++j) {
        if (!(joints[j][2] > 1e-3)) {
            throwInput("{}: expected the body before the camera, found joint {} at z = {:.3f} m",
                       where, j, joints[j][2]);
        }
    }
    const auto [u, v] = camera.project(joints[0]);
    double largest = 0;
    for (const auto& joint : joints) {
        const auto [x, y] = camera.project(joint);
        largest = std::max(largest, std::hypot(x - u, y - v));
    }
    if (!(largest > 0) || !std::isfinite(u + v + largest)) {
        throwInput(
            "{}: expected the body before the camera, found it too far off to be seen: "
            "{:.3g} m",
            where, joints[0][2]);
    }
    return {u, v, 1.1 * largest};
}

Camera cropCamera(const Camera& camera, const CropBox& box, int size) {
    const double scale = size / (2 * box.half);
    return {camera.fx * scale,
            camera.fy * scale,
            (camera.cx - box.centreX + box.half) * scale,
            (camera.cy - box.centreY + box.half) * scale,
            size,
            size};
}

Crop crop(const Picture& picture, const Camera& camera, const CropBox& box, int size) {
    CHECK(size > 0 && box.half > 0, "a crop has pixels, not {} of half size {}", size, box.half);
    const double step = 2 * box.half / size;
    const auto columns = tapsOf(box.centreX - box.half, step, size, picture.width);
    const auto rows = tapsOf(box.centreY - box.half, step, size, picture.height);
    Crop result;
    result.camera = cropCamera(camera, box, size);
    result.image = resample(picture.rgb, picture.width, 3, columns, rows);
    result.inside.resize(size_t(size) * size_t(size));
    for (size_t y = 0; y < rows.size(); ++y) {
        for (size_t x = 0; x < columns.size(); ++x) {
            result.inside[y * columns.size() + x] =
                static_cast<float>(rows[y].inside * columns[x].inside);
        }
    }
    if (!picture.mask.empty()) {
        result.mask = resample(picture.mask, picture.width, 1, columns, rows);
        // What lies outside the frame is nobody.
        for (size_t p = 0; p < result.mask.size(); ++p) result.mask[p] *= result.inside[p];
    }
    return result;
}

// ---- writing ------------------------------------------------------------------------------------

Npz posesArrays(std::span<const Theta> theta, std::span<const Trans> trans, const Betas& betas) {
    const auto frames = static_cast<int64_t>(theta.size());
    std::vector<float> orient, body, transl;
    for (size_t f = 0; f < theta.size(); ++f) {
        orient.insert(orient.end(), theta[f].begin(), theta[f].begin() + 3);
        body.insert(body.end(), theta[f].begin() + 3, theta[f].end());
        transl.insert(transl.end(), trans[f].begin(), trans[f].end());
    }
    Npz poses;
    poses.set("betas", Array::f32({10}, betas));
    poses.set("global_orient", Array::f32({frames, 3}, orient));
    poses.set("body_pose", Array::f32({frames, 69}, body));
    poses.set("transl", Array::f32({frames, 3}, transl));
    return poses;
}

CaptureWriter::CaptureWriter(const fs::path& folder) : output_(folder, "capture") {}

void CaptureWriter::copyImage(const std::string& name, const fs::path& file) {
    createFolders(output_.folder() / "images");
    const fs::path place = fs::path("images") / (name + file.extension().string());
    copyFile(file, output_.folder() / place);
    images_[name] = place;
}

void CaptureWriter::copyMask(const std::string& name, const fs::path& file) {
    createFolders(output_.folder() / "masks");
    const fs::path place = fs::path("masks") / (name + file.extension().string());
    copyFile(file, output_.folder() / place);
    masks_[name] = place;
}

void CaptureWriter::addImage(const std::string& name, int width, int height,
                             std::span<const uint8_t> rgb) {
    Image image(width, height, 3);
    CHECK(rgb.size() == image.data.size(), "a picture is [{}][{}][3]", height, width);
    std::copy(rgb.begin(), rgb.end(), image.data.begin());
    createFolders(output_.folder() / "images");
    images_[name] = fs::path("images") / (name + ".png");
    writeImage(output_.folder() / images_[name], image);
}

void CaptureWriter::addMask(const std::string& name, int width, int height,
                            std::span<const uint8_t> mask) {
    Image image(width, height, 1);
    CHECK(mask.size() == image.data.size(), "a mask is [{}][{}]", height, width);
    std::transform(mask.begin(), mask.end(), image.data.begin(),
                   [](uint8_t value) { return uint8_t(value > 0 ? 255 : 0); });
    createFolders(output_.folder() / "masks");
    masks_[name] = fs::path("masks") / (name + ".png");
    writeImage(output_.folder() / masks_[name], image);
}

Capture CaptureWriter::commit(const Capture& capture) {
    const size_t frames = capture.size();
    const fs::path& folder = output_.folder();
    CHECK(frames > 0, "a capture to write has frames");
    CHECK(capture.theta.size() == frames && capture.trans.size() == frames,
          "a capture has a pose per frame");
    for (const Frame& frame : capture.frames) {
        CHECK(images_.contains(frame.name), "the frame {} was added before commit()", frame.name);
        if (!masks_.empty() && !masks_.contains(frame.name)) {
            throwInput("{}: expected masks for all frames or for none, found none for {}",
                       output_.target().string(), frame.name);
        }
    }

    Npz cameras;
    const auto all = static_cast<int64_t>(frames);
    const Camera& first = capture.frames[0].camera;
    const bool same = std::all_of(capture.frames.begin(), capture.frames.end(),
                                  [&](const Frame& f) { return f.camera == first; });
    std::vector<double> intrinsic, identity(16, 0.);
    std::vector<int64_t> heights, widths;
    for (size_t f = 0; f < (same ? 1 : frames); ++f) {
        const Camera& c = capture.frames[f].camera;
        intrinsic.insert(intrinsic.end(), {c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1});
        heights.push_back(c.height);
        widths.push_back(c.width);
    }
    for (size_t i = 0; i < 4; ++i) identity[5 * i] = 1;
    if (same) {
        cameras.set("intrinsic", Array::f64({3, 3}, intrinsic));
        cameras.set("height", Array::scalarI64(heights[0]));
        cameras.set("width", Array::scalarI64(widths[0]));
    } else {
        cameras.set("intrinsic", Array::f64({all, 3, 3}, intrinsic));
        cameras.set("height", Array::i64({all}, heights));
        cameras.set("width", Array::i64({all}, widths));
    }
    cameras.set("extrinsic", Array::f64({4, 4}, identity));
    writeNpz(folder / "cameras.npz", cameras, false);

    writeNpz(folder / "poses.npz", posesArrays(capture.theta, capture.trans, capture.betas), false);

    toml::table notes;
    notes.insert("name", capture.name);
    if (!capture.actor.empty()) notes.insert("actor", capture.actor);
    if (!capture.motion.empty()) notes.insert("motion", capture.motion);
    notes.insert("fps", capture.fps);
    toml::array names;
    for (const Frame& frame : capture.frames) names.push_back(frame.name);
    notes.insert("frames", std::move(names));
    if (capture.keypoints) {
        const Keypoints& k = *capture.keypoints;
        writeNpy(folder / "keypoints.npy", Array::f32({all, int64_t(k.count), 3}, k.values));
        notes.insert("keypoints", toml::table{{"scheme", k.scheme}});
    }
    toml::table source;
    for (const auto& [key, text] : capture.source) source.insert(key, text);
    if (capture.sourceBetas) {
        toml::array betas;
        for (float beta : *capture.sourceBetas) betas.push_back(double(beta));
        source.insert("betas", std::move(betas));
    }
    if (!source.empty()) notes.insert("source", std::move(source));
    std::ostringstream text;
    text << notes << "\n";
    const std::string written = text.str();
    writeWholeFile(folder / "capture.toml",
                   std::span(reinterpret_cast<const uint8_t*>(written.data()), written.size()));

    // What would not be read back is not written.
    Capture result;
    try {
        result = readCapture(folder);
    } catch (const InputError& error) {
        std::string sentence = error.what();
        const std::string temporary = folder.string();
        const size_t at = sentence.find(temporary);
        if (at != std::string::npos) {
            sentence.replace(at, temporary.size(), output_.target().string());
        }
        throw InputError(sentence);
    }
    output_.commit();
    result.folder = output_.target();
    for (Frame& frame : result.frames) {
        frame.image = result.folder / images_.at(frame.name);
        if (frame.mask) frame.mask = result.folder / masks_.at(frame.name);
    }
    return result;
}

Capture writeCapture(const Capture& capture, const fs::path& folder) {
    CaptureWriter writer(folder);
    return writeCapture(capture, writer);
}

Capture writeCapture(const Capture& capture, CaptureWriter& writer) {
    for (const Frame& frame : capture.frames) {
        writer.copyImage(frame.name, frame.image);
        if (frame.mask) writer.copyMask(frame.name, *frame.mask);
    }
    return writer.commit(capture);
}

}  // namespace doppel
