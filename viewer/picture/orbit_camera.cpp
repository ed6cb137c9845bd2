#include "viewer/picture/orbit_camera.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <glm/ext/matrix_transform.hpp>
#include <nlohmann/json.hpp>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr double kDegree = 3.14159265358979323846 / 180;
constexpr double kLongLens = 200;  // times as far away, times as long
constexpr double kSteepest = 1.55;
constexpr double kNearest = 0.05, kFarthest = 100;

double focal(double fieldOfView, int height) { return 0.5 * height / std::tan(fieldOfView / 2); }

}  // namespace

ViewTransform OrbitCamera::view() const {
    glm::dmat4 turn = glm::rotate(glm::dmat4(1), pitch, glm::dvec3(1, 0, 0)) *
                      glm::rotate(glm::dmat4(1), yaw, glm::dvec3(0, 1, 0));
    glm::dmat3 rotation(turn);
    glm::dvec3 away(0, 0, orthographic ? kLongLens * distance : distance);
    return {rotation, away - rotation * target};
}

Camera OrbitCamera::camera(int width, int height) const {
    double f = focal(fieldOfView, height) * (orthographic ? kLongLens : 1);
    return {f, f, width / 2.0, height / 2.0, width, height};
}

OrbitCamera OrbitCamera::turned(double turns) const {
    OrbitCamera camera = *this;
    camera.yaw += 2 * std::acos(-1.0) * turns;
    return camera;
}

void OrbitCamera::orbit(double right, double down, int height) {
    double radians = 3.2 / std::max(height, 1);
    yaw = std::remainder(yaw - right * radians, 2 * std::acos(-1.0));
    pitch = std::clamp(pitch + down * radians, -kSteepest, kSteepest);
}

void OrbitCamera::pan(double right, double down, int height) {
    double metres = distance / focal(fieldOfView, height);
    target -= glm::transpose(view().rotation) * glm::dvec3(right * metres, down * metres, 0);
}

void OrbitCamera::look(double right, double down, int height) {
    const glm::dvec3 ahead(0, 0, distance);
    const glm::dvec3 eye = target - glm::transpose(view().rotation) * ahead;
    orbit(right, down, height);
    target = eye + glm::transpose(view().rotation) * ahead;
}

void OrbitCamera::walk(const glm::dvec3& metres) {
    target += glm::transpose(view().rotation) * metres;
}

void OrbitCamera::dolly(double factor) {
    if (std::isfinite(factor) && factor > 0)
        distance = std::clamp(distance * factor, kNearest, kFarthest);
}

void OrbitCamera::dollyAt(double factor, double right, double down, int height) {
    const double before = distance;
    dolly(factor);
    // The plane through the target is seen larger: it is moved back by what it has gained there.
    const double metres = (before - distance) / focal(fieldOfView, height);
    target += glm::transpose(view().rotation) * glm::dvec3(right * metres, down * metres, 0);
}

void OrbitCamera::frame(std::span<const float> points, int width, int height) {
    if (points.size() < 3) return;
    glm::dvec3 low(INFINITY), high(-INFINITY);
    for (size_t i = 0; i + 2 < points.size(); i += 3) {
        glm::dvec3 p(points[i], points[i + 1], points[i + 2]);
        low = glm::min(low, p);
        high = glm::max(high, p);
    }
    target = (low + high) / 2.0;
    // Each point asks for a distance at which it is inside the picture.
    glm::dmat3 rotation = view().rotation;
    double f = focal(fieldOfView, height) / 0.9;  // a tenth of the picture stays free
    double needed = kNearest;
    for (size_t i = 0; i + 2 < points.size(); i += 3) {
        glm::dvec3 p = rotation * (glm::dvec3(points[i], points[i + 1], points[i + 2]) - target);
        double depth = orthographic ? 0 : p.z;
        needed = std::max({needed, 2 * f * std::abs(p.x) / width - depth,
                           2 * f * std::abs(p.y) / height - depth});
    }
    distance = std::clamp(needed, kNearest, kFarthest);
}

std::string cameraText(const OrbitCamera& camera) {
    return fmt::format("{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f}{}", camera.yaw / kDegree,
                       camera.pitch / kDegree, camera.distance, camera.target.x, camera.target.y,
                       camera.target.z, camera.fieldOfView / kDegree,
                       camera.orthographic ? ",ortho" : "");
}

std::string cameraJson(const OrbitCamera& camera, int width, int height) {
    const Camera lens = camera.camera(width, height);
    const ViewTransform view = camera.view();
    nlohmann::ordered_json json{
        {"camera", cameraText(camera)}, {"width", width}, {"height", height}};
    json["intrinsic"] = {{lens.fx, 0, lens.cx}, {0, lens.fy, lens.cy}, {0, 0, 1}};
    for (int row = 0; row < 3; ++row)
        json["extrinsic"].push_back({view.rotation[0][row], view.rotation[1][row],
                                     view.rotation[2][row], view.translation[row]});
    json["extrinsic"].push_back({0, 0, 0, 1});
    return json.dump(2);
}

OrbitCamera readCameraText(std::string_view given) {
    constexpr size_t kMostJson = 4000;
    if (given.starts_with('{') && given.size() < kMostJson) {
        const nlohmann::json json = nlohmann::json::parse(given, nullptr, false);
        const auto text = json.is_object() ? json.find("camera") : json.end();
        if (text != json.end() && text->is_string())
            return readCameraText(text->get<std::string>());
    }
    std::string text(given.substr(0, 400));
    while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
    const std::string shown = text;
    constexpr std::string_view kFlag = "--camera", kOrtho = ",ortho";
    if (text.starts_with(kFlag)) text.erase(0, kFlag.size() + (text.size() > kFlag.size()));
    OrbitCamera camera;
    camera.orthographic = text.ends_with(kOrtho);
    if (camera.orthographic) text.resize(text.size() - kOrtho.size());
    double yaw = 0, pitch = 0, field = 0;
    int used = 0;
    const int count =
        std::sscanf(text.c_str(), "%lf,%lf,%lf,%lf,%lf,%lf,%lf%n", &yaw, &pitch, &camera.distance,
                    &camera.target.x, &camera.target.y, &camera.target.z, &field, &used);
    const bool sensible = std::abs(yaw) <= 360 && std::abs(pitch) <= 90 &&
                          camera.distance >= kNearest && camera.distance <= kFarthest &&
                          std::abs(camera.target.x) <= 1e4 && std::abs(camera.target.y) <= 1e4 &&
                          std::abs(camera.target.z) <= 1e4 && field >= 1 && field <= 150;
    if (count != 7 || static_cast<size_t>(used) != text.size() || !sensible)
        throwInput(
            "camera: expected YAW,PITCH,DISTANCE,X,Y,Z,FIELD[,ortho] in degrees and metres, "
            "as the viewer copies it, found \"{}\"",
            shown.substr(0, 100));
    camera.yaw = yaw * kDegree;
    camera.pitch = std::clamp(pitch * kDegree, -kSteepest, kSteepest);
    camera.fieldOfView = field * kDegree;
    return camera;
}

glm::dvec3 projected(const glm::dvec3& world, const ViewTransform& view, const Camera& camera) {
    glm::dvec3 p = view(world);
    double z = p.z > 0 ? p.z : 1;
    return {camera.fx * p.x / z + camera.cx, camera.fy * p.y / z + camera.cy, p.z};
}

glm::dvec3 movedInPlane(const glm::dvec3& world, double right, double down,
                        const ViewTransform& view, const Camera& camera) {
    double z = view(world).z;
    return world + glm::transpose(view.rotation) *
                       glm::dvec3(right * z / camera.fx, down * z / camera.fy, 0);
}

}  // namespace doppel
