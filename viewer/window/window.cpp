#include "viewer/window/window.h"

// GLFW declares its Vulkan functions where Vulkan came first.
#include "viewer/window/swapchain.h"
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>
#include <backends/imgui_impl_glfw.h>
#include <imgui.h>

#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

#include "engine/error.h"
#include "viewer/window/icon.h"

namespace doppel {

namespace {

// Of the window where it has no picture.
constexpr uint32_t kLightGrey = 0xffe8e8e8, kDarkGrey = 0xff1e1e1e;

std::string glfwReason() {
    const char* text = nullptr;
    glfwGetError(&text);
    return text ? text : "no reason given";
}

// The key that has this on it where the keyboard is not an American one: GLFW numbers keys by their
// places, and who presses Ctrl and what is labelled Z means to undo. Digits keep their places, for
// French keyboards print other things there; so does all of what prints no ASCII.
int labelledKey(int key, int scancode) {
    const bool prints = key > GLFW_KEY_SPACE && key < GLFW_KEY_ESCAPE;
    if (!prints || (key >= GLFW_KEY_0 && key <= GLFW_KEY_9)) return key;
    const char* name = glfwGetKeyName(key, scancode);
    if (!name || name[0] <= ' ' || name[0] > '~' || name[1] != 0) return key;
    if (name[0] >= '0' && name[0] <= '9') return key;
    return name[0] >= 'a' && name[0] <= 'z' ? name[0] - 'a' + GLFW_KEY_A : name[0];
}

}  // namespace

bool presentsDirectly(const DeviceInfo& info) {
    const char* set = std::getenv("DOPPEL_PRESENT");
    const std::string_view wish = set ? set : "";
    if (wish.empty()) return !info.cpu;
    if (wish != "direct" && wish != "host")
        throwInput("DOPPEL_PRESENT: expected direct or host, or nothing, found {}", wish);
    return wish == "direct";
}

struct Window::Parts {
    GLFWwindow* window = nullptr;
    glm::ivec2 asked{}, opened{};  // its size: as the options said it, and as it came
    std::vector<KeyPress> keys, keysNow;
    std::set<int> down;
    bool mouseHeld = false;
    std::vector<std::filesystem::path> dropped;
    bool touched = false;
    bool imguiReady = false;
    std::string presenter;  // part of its name, where the window has its own
    std::shared_ptr<Device> device;
    std::optional<Swapchain> swapchain;
    std::optional<DeviceComposer> composer;  // where the device composes
    InterfaceLayer layer;
    Canvas canvas;  // as the host composed it last

    // Asked for once per frame: each is a message to the X server and back.
    int wide = 0, high = 0;  // 0 while minimised
    double scale = 1, contentScale = 1;
    double ownScale = 1;
    Theme theme = Theme::Dark;
    std::optional<Look> look;  // as Dear ImGui has it

    Look wantedLook() const { return {contentScale * ownScale / scale, scale, theme}; }

    ~Parts();
    void openWindow(const WindowOptions& options);
    void resize(glm::ivec2 size);
    void setIcon();
    void listen();
    void openSwapchain();
    void dropSwapchain();
    void openImGui();
    void measure();
};

void Window::Parts::openWindow(const WindowOptions& options) {
    if (!glfwInit())
        throwMachine("no window can be opened: {}; over ssh, DISPLAY has to be set, or use Xvfb",
                     glfwReason());
    if (!glfwVulkanSupported())
        throwMachine(
            "no window can be opened: the Vulkan loader or its surface extensions are "
            "missing ({})",
            glfwReason());
    glfwWindowHint(GLFW_CLIENT_API, GLFW_NO_API);
    glfwWindowHint(GLFW_SCALE_TO_MONITOR, GLFW_TRUE);
    window =
        glfwCreateWindow(options.width, options.height, options.title.c_str(), nullptr, nullptr);
    if (!window) throwMachine("no window can be opened: {}", glfwReason());
    asked = {options.width, options.height};
    glfwGetWindowSize(window, &opened.x, &opened.y);
    setIcon();
    measure();
    glfwSetWindowUserPointer(window, this);
    listen();
}

// Unless the user has changed it. What is larger stays on its monitor, around the same centre.
void Window::Parts::resize(glm::ivec2 size) {
    glm::ivec2 now{}, place{}, low{}, room{};
    glfwGetWindowSize(window, &now.x, &now.y);
    if (now != opened || glfwGetWindowAttrib(window, GLFW_MAXIMIZED)) return;
    const glm::ivec2 wanted = glm::dvec2(size) * glm::dvec2(opened) / glm::dvec2(asked);
    glfwGetWindowPos(window, &place.x, &place.y);
    const glm::ivec2 centre = place + now / 2;
    int count = 0;
    GLFWmonitor** monitors = glfwGetMonitors(&count);
    for (int i = 0; i < count; ++i) {
        glfwGetMonitorWorkarea(monitors[i], &low.x, &low.y, &room.x, &room.y);
        if (glm::any(glm::lessThan(centre, low)) ||
            glm::any(glm::greaterThanEqual(centre, low + room)))
            continue;
        const glm::ivec2 corner = glm::max(low, glm::min(centre - wanted / 2, low + room - wanted));
        glfwSetWindowPos(window, corner.x, corner.y);
        break;
    }
    glfwSetWindowSize(window, wanted.x, wanted.y);
    // A window manager takes a moment, and may have another mind.
    for (int turn = 0; turn < 10 && now != wanted; ++turn) {
        glfwWaitEventsTimeout(.02);
        glfwGetWindowSize(window, &now.x, &now.y);
    }
    asked = size;
    opened = now;
    measure();
}

// Of the sizes that desktops take: title bars, task bars, switchers.
void Window::Parts::setIcon() {
    std::vector<Image> icons;
    for (int side : {16, 32, 48, 64}) icons.push_back(applicationIcon(side));
    std::vector<GLFWimage> images;
    for (Image& icon : icons) images.push_back({icon.width, icon.height, icon.data.data()});
    glfwSetWindowIcon(window, static_cast<int>(images.size()), images.data());
}

// Before ImGui does, which calls these in turn.
void Window::Parts::listen() {
    static constexpr auto of = [](GLFWwindow* w) -> Parts& {
        return *static_cast<Parts*>(glfwGetWindowUserPointer(w));
    };
    glfwSetKeyCallback(window, [](GLFWwindow* w, int key, int scancode, int action, int modifiers) {
        Parts& p = of(w);
        p.touched = true;
        const int labelled = labelledKey(key, scancode);
        if (action == GLFW_RELEASE) {
            p.down.erase(labelled);
            return;
        }
        p.down.insert(labelled);
        p.keys.push_back({labelled, modifiers, action == GLFW_REPEAT});
    });
    glfwSetDropCallback(window, [](GLFWwindow* w, int count, const char** paths) {
        of(w).touched = true;
        of(w).dropped.insert(of(w).dropped.end(), paths, paths + count);
    });
    glfwSetFramebufferSizeCallback(window, [](GLFWwindow* w, int, int) {
        of(w).touched = true;
        if (of(w).swapchain) of(w).swapchain->lose();
    });
    glfwSetCharCallback(window, [](GLFWwindow* w, unsigned) { of(w).touched = true; });
    glfwSetMouseButtonCallback(window, [](GLFWwindow* w, int, int, int) { of(w).touched = true; });
    glfwSetCursorPosCallback(window, [](GLFWwindow* w, double, double) { of(w).touched = true; });
    glfwSetScrollCallback(window, [](GLFWwindow* w, double, double) { of(w).touched = true; });
    glfwSetCursorEnterCallback(window, [](GLFWwindow* w, int) { of(w).touched = true; });
    glfwSetWindowFocusCallback(window, [](GLFWwindow* w, int focused) {
        of(w).touched = true;
        if (!focused) of(w).down.clear();  // whoever has the keyboard hears of their release
    });
    glfwSetWindowIconifyCallback(window, [](GLFWwindow* w, int) { of(w).touched = true; });
    glfwSetWindowContentScaleCallback(window,
                                      [](GLFWwindow* w, float, float) { of(w).touched = true; });
    glfwSetWindowRefreshCallback(window, [](GLFWwindow* w) { of(w).touched = true; });
}

void Window::Parts::openSwapchain() {
    uint32_t count = 0;
    const char** extensions = glfwGetRequiredInstanceExtensions(&count);
    swapchain.emplace(
        SurfaceSource{
            .extensions = {extensions, count},
            .makeSurface =
                [this](VkInstance instance, VkSurfaceKHR* surface) {
                    return glfwCreateWindowSurface(instance, window, nullptr, surface);
                },
            .size =
                [this] {
                    int width = 0, height = 0;
                    glfwGetFramebufferSize(window, &width, &height);
                    return VkExtent2D{static_cast<uint32_t>(width), static_cast<uint32_t>(height)};
                }},
        device.get(), presenter);
    if (swapchain->composing()) composer.emplace(*device);
}

void Window::Parts::dropSwapchain() {
    swapchain.reset();  // which waits for what the composer has begun
    composer.reset();
}

void Window::Parts::openImGui() {
    IMGUI_CHECKVERSION();
    ImGui::CreateContext();
    imguiReady = true;
    ImGuiIO& io = ImGui::GetIO();
    io.IniFilename = nullptr;  // nothing is written into the user's folders
    io.BackendRendererName = "doppel";
    io.BackendFlags |= ImGuiBackendFlags_RendererHasVtxOffset;
    look = wantedLook();
    applyLook(*look);
    ImGui_ImplGlfw_InitForOther(window, true);
}

void Window::Parts::measure() {
    int across = 0;
    glfwGetFramebufferSize(window, &wide, &high);
    glfwGetWindowSize(window, &across, nullptr);
    scale = across > 0 ? static_cast<double>(wide) / across : 1;
    float x = 1, y = 1;
    glfwGetWindowContentScale(window, &x, &y);
    contentScale = std::clamp(static_cast<double>(std::max(x, y)), .5, 8.);
    if (glfwGetWindowAttrib(window, GLFW_ICONIFIED)) wide = high = 0;
}

Window::Parts::~Parts() {
    if (imguiReady) {
        if (ImGui::GetIO().BackendPlatformUserData) ImGui_ImplGlfw_Shutdown();
        ImGui::DestroyContext();
    }
    dropSwapchain();
    if (window) glfwDestroyWindow(window);
    glfwTerminate();
}

Window::Window(const WindowOptions& options) : parts_(std::make_unique<Parts>()) {
    parts_->ownScale = options.scale;
    parts_->theme = options.theme;
    parts_->openWindow(options);
    parts_->presenter = options.device;
    parts_->openImGui();
}

Window::~Window() = default;

std::vector<const char*> Window::surfaceExtensions() const {
    uint32_t count = 0;
    const char** extensions = glfwGetRequiredInstanceExtensions(&count);
    return {extensions, extensions + count};
}

void Window::present(std::shared_ptr<Device> composing) {
    parts_->dropSwapchain();
    parts_->device = std::move(composing);
    parts_->openSwapchain();
}

void Window::become(const WindowOptions& options) {
    setTitle(options.title);
    setLook(options.scale, options.theme);
    parts_->presenter = options.device;
    parts_->resize({options.width, options.height});
}

bool Window::directly() const { return parts_->composer.has_value(); }

bool Window::begin(double seconds) {
    Parts& p = *parts_;
    p.keys.clear();
    p.touched = false;
    if (seconds > 0)
        glfwWaitEventsTimeout(seconds);
    else
        glfwPollEvents();
    p.keysNow = std::exchange(p.keys, {});
    p.measure();
    return p.wide > 0 && p.high > 0;
}

void Window::beginFrame() {
    Parts& p = *parts_;
    if (p.wide > 0 && p.look != p.wantedLook()) {
        p.look = p.wantedLook();
        applyLook(*p.look);
    }
    ImGui_ImplGlfw_NewFrame();
    if (p.mouseHeld) ImGui::GetIO().MousePos = {-FLT_MAX, -FLT_MAX};
    ImGui::NewFrame();
}

void Window::end(std::span<const PlacedPicture> pictures) {
    ImGui::Render();
    Parts& p = *parts_;
    Swapchain& screen = *p.swapchain;
    if (!screen.next()) return;
    FontAtlas font;
    unsigned char* texels = nullptr;
    ImGui::GetIO().Fonts->GetTexDataAsAlpha8(&texels, &font.width, &font.height);
    font.texels = texels;
    p.layer.begin(screen.width(), screen.height());
    drawInterface(*ImGui::GetDrawData(), font, p.layer);
    const std::vector<FramePart> parts =
        partsOfFrame(pictures, screen.width(), screen.height(),
                     p.theme == Theme::Light ? kLightGrey : kDarkGrey);
    if (p.composer) {
        screen.present(&p.composer->compose(pictures, parts, p.layer, screen.blueFirst()));
    } else {
        p.canvas = screen.canvas();
        compose(parts, p.layer, p.canvas);
        screen.present();
    }
}

bool Window::closed() const { return glfwWindowShouldClose(parts_->window); }
void Window::close() { glfwSetWindowShouldClose(parts_->window, GLFW_TRUE); }
void Window::keepOpen() { glfwSetWindowShouldClose(parts_->window, GLFW_FALSE); }

bool Window::touched() const { return parts_->touched; }
int Window::width() const { return parts_->wide; }
int Window::height() const { return parts_->high; }
double Window::scale() const { return parts_->scale; }
double Window::unit() const { return parts_->wantedLook().unit; }
void Window::setLook(double scale, Theme theme) {
    parts_->ownScale = scale;
    parts_->theme = theme;
}

void Window::holdMouse(bool hold) {
    parts_->mouseHeld = hold;
    glfwSetInputMode(parts_->window, GLFW_CURSOR, hold ? GLFW_CURSOR_DISABLED : GLFW_CURSOR_NORMAL);
}
glm::dvec2 Window::mouse() const {
    glm::dvec2 at{};
    glfwGetCursorPos(parts_->window, &at.x, &at.y);
    return at;
}
bool Window::isDown(int key) const { return parts_->down.contains(key); }
const std::vector<KeyPress>& Window::keys() const { return parts_->keysNow; }
void Window::setTitle(const std::string& title) {
    glfwSetWindowTitle(parts_->window, title.c_str());
}
std::string Window::clipboard() const {
    const char* text = glfwGetClipboardString(parts_->window);
    return text ? text : "";
}
void Window::setClipboard(const std::string& text) {
    glfwSetClipboardString(parts_->window, text.c_str());
}
std::vector<std::filesystem::path> Window::dropped() { return std::exchange(parts_->dropped, {}); }
void Window::drop(std::span<const std::filesystem::path> paths) {
    parts_->dropped.insert(parts_->dropped.end(), paths.begin(), paths.end());
}
int Window::swapchainCount() const { return parts_->swapchain->count(); }
Canvas Window::drawn() const { return directly() ? parts_->composer->read() : parts_->canvas; }
uint64_t Window::uploadedBytes() const {
    return directly() ? parts_->composer->uploadedBytes() : parts_->canvas.pixels.size_bytes();
}
void Window::loseSwapchain() { parts_->swapchain->lose(); }

}  // namespace doppel
