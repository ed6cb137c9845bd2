// A window: events, and pictures with Dear ImGui over them.
//
// Dear ImGui is drawn by the host as a layer. Either the device that computes the pictures lays it
// over them and presents, and what it computed stays where it lies; or the host does, and presents
// with a Vulkan device of the window's own, so that the one that computes needs no surface.
#pragma once

#include <cstdint>
#include <filesystem>
#include <glm/glm.hpp>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "viewer/window/frame.h"
#include "viewer/window/look.h"

namespace doppel {

// A key that went down: GLFW's number and modifier bits. Letters and signs are those that the
// keyboard's layout has on it, as ASCII and GLFW number them both.
struct KeyPress {
    int key = 0, modifiers = 0;
    bool repeated = false;  // it is held, and went down earlier
};

struct WindowOptions {
    std::string title = "Doppel";
    int width = 1280, height = 800;  // times the monitor's content scale
    double scale = 1;                // of the interface, besides the monitor's
    Theme theme = Theme::Dark;
    std::string device;  // part of the name of the device that should present where the window's
                         // own does; empty: any
};

// Whether a device that can present what it computes shall: DOPPEL_PRESENT=direct or =host says it;
// else a GPU does, and a CPU does not, which copies faster than it composes.
bool presentsDirectly(const DeviceInfo& info);

class Window {
public:
    // MachineError where there is no screen.
    explicit Window(const WindowOptions& options);
    ~Window();
    Window(const Window&) = delete;
    Window& operator=(const Window&) = delete;

    // Of the instance of a device that shall present on it; valid as long as the window.
    std::vector<const char*> surfaceExtensions() const;
    // Before the first begin(), and again for another device: what end() is given is composed and
    // presented by this device if it can, which directly() says; else, or without one, by the host.
    // MachineError where no device can present on the screen.
    void present(std::shared_ptr<Device> composing);
    bool directly() const;

    // Goes on as a window that was opened with these, where something else is shown in it from now
    // on. It keeps the size that the user gave it.
    void become(const WindowOptions& options);

    // Takes events, at most `seconds` waiting for one; 0 does not wait. False where there is
    // nothing to draw on (minimised, or no size).
    bool begin(double seconds);
    // Begins a frame of Dear ImGui, which end() draws. Each has all that the interface shows: Dear
    // ImGui takes what is left out for closed, with the button that is held and the field that is
    // typed into. Where the screen is to stay as it is, there is no frame.
    void beginFrame();
    // Draws the pictures and ImGui over them. One frame is on its way at most, so what is drawn is
    // on the screen one frame after the events that it answers. What goes wrong on that way, shows
    // here the next time.
    void end(std::span<const PlacedPicture> pictures);

    bool closed() const;
    void close();
    // Takes back that it was closed.
    void keepOpen();
    // Whether the last begin() took an event that the interface may answer.
    bool touched() const;
    // Framebuffer pixels as of the last begin(); 0 while minimised.
    int width() const;
    int height() const;
    // Framebuffer pixels per unit of window coordinates.
    double scale() const;
    // Window coordinates for what is one pixel on a plain monitor: sizes in the interface are given
    // in these.
    double unit() const;
    // The interface's own scale and colours from the next frame on.
    void setLook(double scale, Theme theme);
    // Hides the mouse and lets it go on for ever, as for looking around: Dear ImGui does not see it
    // until it is let go, which puts it back where it was.
    void holdMouse(bool hold);
    // Where it is: window coordinates, beyond the window while it is held.
    glm::dvec2 mouse() const;
    // Whether the key is down; numbered as KeyPress has it.
    bool isDown(int key) const;
    // Keys since the last begin(), in their order.
    const std::vector<KeyPress>& keys() const;
    void setTitle(const std::string& title);
    std::string clipboard() const;
    void setClipboard(const std::string& text);
    // Files dropped on the window since they were asked for.
    std::vector<std::filesystem::path> dropped();
    // As if the user had dropped them.
    void drop(std::span<const std::filesystem::path> paths);
    // How often the swapchain was made anew.
    int swapchainCount() const;
    // The whole window as end() drew it last, which the screen shows a moment later.
    Canvas drawn() const;
    // That the last frame took from the host's memory to the device that presents.
    uint64_t uploadedBytes() const;
    // The next frame finds its swapchain lost, as when a screen is unplugged; for tests.
    void loseSwapchain();

private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

}  // namespace doppel
