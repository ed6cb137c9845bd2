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
#include <optional>
#include <set>
#include <utility>

#include "viewer/window/icon.h"

namespace doppel {

namespace {

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

// Pictures side by side from the corner leave what is right of them and below; others anything.
void place(std::span<const PlacedPicture> pictures, const Canvas& canvas, bool light) {
    int64_t covered = 0;
    int right = 0, bottom = 0;
    for (const PlacedPicture& p : pictures) {
        covered += int64_t{p.width} * p.height;
        right = std::max(right, p.x + p.width);
        bottom = std::max(bottom, p.y + p.height);
    }
    bool tiled = covered == int64_t{right} * bottom;
    const uint32_t grey = light ? 0xffe8e8e8 : 0xff1e1e1e;
    for (int y = 0; y < canvas.height; ++y) {
        bool beside = tiled && y < bottom;
        std::ranges::fill(
            canvas.row(y).subspan(static_cast<size_t>(beside ? std::min(right, canvas.width) : 0)),
            grey);
    }
    for (const PlacedPicture& p : pictures) {
        // What the window no longer has room for, after it has shrunk, is left out.
        int width = std::min(p.width, canvas.width - p.x);
        int height = std::min(p.height, canvas.height - p.y);
        for (int y = 0; y < height && width > 0; ++y)
            std::ranges::copy(
                p.pixels.subspan(static_cast<size_t>(y) * static_cast<size_t>(p.width),
                                 static_cast<size_t>(width)),
                canvas.row(p.y + y).begin() + p.x);
    }
}

}  // namespace

struct Window::Parts {
    GLFWwindow* window = nullptr;
    std::vector<KeyPress> keys, keysNow;
    std::set<int> down;
    bool mouseHeld = false;
    std::vector<std::filesystem::path> dropped;
    bool touched = false;
    bool imguiReady = false;
    std::optional<Swapchain> swapchain;

    // Asked for once per frame: each is a message to the X server and back.
    int wide = 0, high = 0;  // 0 while minimised
    double scale = 1, contentScale = 1;
    double ownScale = 1;
    Theme theme = Theme::Dark;
    std::optional<Look> look;  // as Dear ImGui has it

    Look wantedLook() const { return {contentScale * ownScale / scale, scale, theme}; }

    ~Parts();
    void openWindow(const WindowOptions& options);
    void setIcon();
    void listen();
    void openSwapchain(const std::string& device);
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
    setIcon();
    measure();
    glfwSetWindowUserPointer(window, this);
    listen();
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
        of(w).swapchain->lose();
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

void Window::Parts::openSwapchain(const std::string& device) {
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
        device);
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
    swapchain.reset();
    if (window) glfwDestroyWindow(window);
    glfwTerminate();
}

Window::Window(const WindowOptions& options) : parts_(std::make_unique<Parts>()) {
    parts_->ownScale = options.scale;
    parts_->theme = options.theme;
    parts_->openWindow(options);
    parts_->openSwapchain(options.device);
    parts_->openImGui();
}

Window::~Window() = default;

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
    Canvas canvas = parts_->swapchain->next();
    if (canvas.pixels.empty()) return;
    place(pictures, canvas, parts_->theme == Theme::Light);
    FontAtlas font;
    unsigned char* texels = nullptr;
    ImGui::GetIO().Fonts->GetTexDataAsAlpha8(&texels, &font.width, &font.height);
    font.texels = texels;
    drawInterface(*ImGui::GetDrawData(), font, canvas);
    parts_->swapchain->present();
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

bool Window::blueFirst() const { return parts_->swapchain->blueFirst(); }
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
int Window::swapchainCount() const { return parts_->swapchain->count(); }
const Canvas& Window::drawn() const { return parts_->swapchain->presented(); }
void Window::loseSwapchain() { parts_->swapchain->lose(); }

}  // namespace doppel
