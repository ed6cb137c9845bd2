// The panel's inspector: a click on the body tells what is known of that point of its surface.
#include <imgui.h>

#include "viewer/viewer.h"
#include "viewer/widgets.h"

namespace doppel {

namespace {

const char* originName(TexelOrigin origin) {
    switch (origin) {
        case kFromFrames:
            return "from frames that show it";
        case kFromOtherSide:
            return "from the body's other side: no frame shows it";
        case kFromNeighbours:
            return "from its neighbours: no frame shows it, nor its mirror image";
        default:
            return "none: it lies between the charts";
    }
}

void addRow(const char* name, const std::string& value) {
    ImGui::TableNextRow();
    ImGui::TableNextColumn();
    hint(name);
    ImGui::TableNextColumn();
    words(value);
}

}  // namespace

void Viewer::toggleInspector() {
    tabWanted_ = inspecting() ? "View" : kInspectTab;
    settings_.panel = true;
}

void Viewer::inspectAt(double x, double y) {
    const Pane* pane = paneAt(x, y);
    if (!pane || pane->other) return;
    const Camera camera = cameraOf(*pane);
    const double scale = window_.scale();
    const glm::dvec3 ray((x * scale - pane->x - camera.cx) / camera.fx,
                         (y * scale - pane->y - camera.cy) / camera.fy, 1);
    const auto hit = nearestHit(scene_->vertices(pane->mesh, view()), avatar_->avatar.body.faces,
                                glm::dvec3(0), ray);
    inspected_ = hit ? inspect(avatar_->avatar, hit->point) : std::nullopt;
}

// Takes the sightings that were found, and looks for those of another point, motion or avatar.
void Viewer::followInspected() {
    const OpenedMotion* opened = openedMotion();
    const bool known = inspected_ && opened && !opened->trained.empty();
    const bool same = known && searched_.point == inspected_->point &&
                      searched_.motion.lock() == editor_->motion() &&
                      searched_.avatar.lock() == avatar_;
    if (!same) {
        search_.reset();
        sightings_.reset();
        searched_ = {};
        if (!known) return;
        searched_ = {inspected_->point, editor_->motion(), avatar_};
        search_ = std::make_unique<SightingSearch>(
            options_.device, std::shared_ptr<const Avatar>(avatar_, &avatar_->avatar),
            opened->trained, motion()->cameras, inspected_->point);
    } else if (search_ && !search_->busy()) {
        const std::unique_ptr<SightingSearch> done = std::move(search_);
        sightings_ = done->take();
        framesToDraw_ = std::max(framesToDraw_, 1);
    }
}

// As the frame's own camera saw it, over its picture where that is open.
void Viewer::seeFrame(size_t frame) {
    play(false);
    timeline_ = static_cast<double>(frame);
    settings_.captureCamera = true;
    showFrames();
}

void Viewer::drawInspectTab() {
    if (!inspected_) {
        hint("Click on the body.");
        return;
    }
    const Inspected& at = *inspected_;
    const int size = avatar_->avatar.textureSize;
    if (ImGui::BeginTable("inspected", 2)) {
        ImGui::TableSetupColumn("what", ImGuiTableColumnFlags_WidthFixed,
                                std::ceil(ImGui::CalcTextSize("first colour").x));
        ImGui::TableSetupColumn("value", ImGuiTableColumnFlags_WidthStretch);
        addRow("vertex", fmt::format("{}", at.vertex));
        addRow("part", partName(at.part));
        addRow("UV", fmt::format("{:.4f}, {:.4f}", at.uv.x, at.uv.y));
        addRow("texel", fmt::format("{}, {} of {} x {}", at.texel.x, at.texel.y, size, size));
        addRow("K(v)", fmt::format("{:.1f} mm", 1e3 * at.bound));
        addRow("first colour",
               at.origin ? originName(*at.origin) : "not known: the avatar has no texels_seen.png");
        if (search_)
            addRow("seen", "counting the frames ...");
        else if (!sightings_)
            addRow(
                "seen",
                "not known: what plays is no capture with frames that the avatar was trained on");
        else
            addRow("seen", fmt::format("in {} of {} training frames{}", sightings_->seen,
                                       sightings_->frames,
                                       sightings_->best
                                           ? fmt::format(", largest in frame {}", *sightings_->best)
                                           : std::string()));
        ImGui::EndTable();
    }
    if (sightings_ && sightings_->best &&
        button("see that frame", "Goes there, through the capture's camera."))
        seeFrame(*sightings_->best);
    hint(
        "Seen: the poses that training found have it in the picture, turned to the camera, with "
        "nothing of the body before it.");
}

// Also where the body hides it, for it is to be found again.
void Viewer::drawInspected(const Pane& pane) const {
    if (!inspected_) return;
    const std::vector<float> verts = scene_->vertices(pane.mesh);
    const glm::dvec3 at =
        onScreen(placeOf(inspected_->point, verts, avatar_->avatar.body.faces), pane);
    if (at.z <= 0) return;
    const ImVec2 centre{static_cast<float>(at.x), static_cast<float>(at.y)};
    const auto unit = static_cast<float>(window_.unit());
    ImDrawList& list = *ImGui::GetBackgroundDrawList();
    for (const auto& [colour, thick] :
         {std::pair{IM_COL32(0, 0, 0, 200), 4.f}, {IM_COL32(255, 255, 255, 255), 2.f}}) {
        list.AddCircle(centre, 7 * unit, colour, 0, thick * unit);
        list.AddCircleFilled(centre, .5f * thick * unit, colour);
    }
}

}  // namespace doppel
