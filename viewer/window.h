// A window: events, a swapchain, Dear ImGui, and pictures copied under it.
//
// It presents with a Vulkan device of its own. The pictures come from the compute device by way of
// the host, a megabyte or two per frame: so whatever happens to the window (another screen, a lost
// swapchain) the networks do not notice, and the compute device needs no surface.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace doppel {

// Four bytes per pixel, in the order that Window::blueFirst() says; placed in framebuffer pixels.
struct PlacedPicture {
    int x = 0, y = 0, width = 0, height = 0;
    std::span<const uint32_t> pixels;
};

// A key that went down, or repeats: GLFW's number and modifier bits.
struct KeyPress {
    int key = 0, modifiers = 0;
};

struct WindowOptions {
    std::string title = "Doppel";
    int width = 1280, height = 800;
    std::string device;  // part of the name of the device that should present; empty: any
};

class Window {
public:
    // Mesa 25's lavapipe crashes when it compiles a fragment shader for vectors of 512 bits, which
    // its compute shaders like best, and all of a process has the same. Where a folder "window"
    // beside the manifest that VK_DRIVER_FILES names has another manifest, of a copy of the driver
    // that keeps to 256 bits (scripts/setup makes one), that one draws the window. Without, the
    // whole process goes back to them: so this comes before its first device.
    static void avoidWideVectors();
    // Calls that too. MachineError where there is no screen, or no device that can present on it.
    explicit Window(const WindowOptions& options);
    ~Window();
    Window(const Window&) = delete;
    Window& operator=(const Window&) = delete;

    // Takes events, at most `seconds` waiting for one; 0 does not wait. Then a frame of ImGui has
    // begun, unless there is nothing to draw on (minimised, or no size): then false.
    bool begin(double seconds);
    // Draws the pictures and ImGui over them. One frame is on its way at most, so what is drawn is
    // on the screen one frame after the events that it answers. A thread presents it: a CPU takes
    // milliseconds for that, in which the next frame begins. What goes wrong there, shows here the
    // next time.
    void end(std::span<const PlacedPicture> pictures);

    // Instead of end(): the screen stays as it is.
    void skip();

    bool closed() const;
    void close();
    // Framebuffer pixels as of the last begin(); 0 while minimised.
    int width() const;
    int height() const;
    // Framebuffer pixels per unit of window coordinates.
    double scale() const;
    bool blueFirst() const;
    // Keys since the last begin(), in their order.
    const std::vector<KeyPress>& keys() const;
    void setTitle(const std::string& title);
    std::string clipboard() const;
    void setClipboard(const std::string& text);
    // Files dropped on the window since the last begin().
    std::vector<std::filesystem::path> dropped();
    // The name of the device that presents.
    const std::string& deviceName() const;
    // How often the swapchain was made anew.
    int swapchainCount() const;
    // The next frame finds its swapchain lost, as when a screen is unplugged; for tests.
    void loseSwapchain();

private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

}  // namespace doppel
