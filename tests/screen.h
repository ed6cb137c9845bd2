// A screen of its own for tests that open windows, and hands on its mouse and keyboard.
#pragma once

#include <functional>
#include <string>

#include "engine/io/image.h"

namespace doppel::test {

// Starts Xvfb with a free display number and points DISPLAY at it; ends it with the object.
class Screen {
public:
    Screen(int width, int height);  // throws std::runtime_error with the reason
    ~Screen();
    Screen(const Screen&) = delete;
    Screen& operator=(const Screen&) = delete;

    void move(double x, double y);
    void press(int button);  // 1 left, 2 middle, 3 right, 4 and 5 the wheel up and down
    void release(int button);
    void click(int button) {
        press(button);
        release(button);
    }
    // Names as X has them: "z", "Control_L", "Home", "KP_1".
    void keyDown(const std::string& name);
    void keyUp(const std::string& name);
    void key(const std::string& name) {
        keyDown(name);
        keyUp(name);
    }

    // The first that is there.
    unsigned long window();
    std::string title();
    // The largest of its icons, R, G, B, A; empty: it has none.
    Image icon();
    // As the desktop says it to windows that are opened from now on; 96 is a plain monitor.
    void setDpi(int dpi);
    void resizeWindow(int width, int height);
    void hideWindow();
    // Asks it to close, as its own button does.
    void closeWindow();
    void showWindow();
    // Drops a text/uri-list there, as file managers do (XDND 5). meanwhile: called over and over,
    // so that the window answers. Whether it said that it took them.
    bool drop(const std::string& uriList, int x, int y, const std::function<void()>& meanwhile);

    // What is on the screen.
    Image grab(int x, int y, int width, int height);

private:
    void tell(unsigned long source, const char* message, long second, long third, long fourth,
              long fifth);
    void* display_ = nullptr;
    int process_ = -1;
};

}  // namespace doppel::test
