#include "tests/screen.h"

#include <X11/Xatom.h>
#include <X11/Xlib.h>
#include <X11/Xutil.h>
#include <X11/extensions/XTest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <optional>
#include <stdexcept>

namespace doppel::test {

namespace {

Display* asDisplay(void* display) { return static_cast<Display*>(display); }

}  // namespace

Screen::Screen(int width, int height) {
    int number[2];
    if (pipe(number) != 0) throw std::runtime_error("no pipe");
    process_ = fork();
    if (process_ == 0) {
        prctl(PR_SET_PDEATHSIG, SIGTERM);  // it ends with a test that is killed
        close(number[0]);
        std::string to = std::to_string(number[1]);
        std::string size = std::to_string(width) + "x" + std::to_string(height) + "x24";
        if (!freopen("/dev/null", "w", stderr)) _exit(126);
        execlp("Xvfb", "Xvfb", "-displayfd", to.c_str(), "-screen", "0", size.c_str(), "-nolisten",
               "tcp", "-noreset", nullptr);
        _exit(127);
    }
    close(number[1]);
    std::string text;
    char c = 0;
    while (read(number[0], &c, 1) == 1 && c != '\n') text += c;
    close(number[0]);
    if (text.empty()) throw std::runtime_error("Xvfb does not start; is it installed?");
    setenv("DISPLAY", (":" + text).c_str(), 1);
    display_ = XOpenDisplay((":" + text).c_str());
    if (!display_) throw std::runtime_error("no connection to Xvfb");
}

Screen::~Screen() {
    if (display_) XCloseDisplay(asDisplay(display_));
    if (process_ > 0) {
        kill(process_, SIGTERM);
        waitpid(process_, nullptr, 0);
    }
}

void Screen::move(double x, double y) {
    XTestFakeMotionEvent(asDisplay(display_), -1, static_cast<int>(x + 0.5),
                         static_cast<int>(y + 0.5), CurrentTime);
    XSync(asDisplay(display_), False);
}

void Screen::press(int button) {
    XTestFakeButtonEvent(asDisplay(display_), static_cast<unsigned>(button), True, CurrentTime);
    XSync(asDisplay(display_), False);
}

void Screen::release(int button) {
    XTestFakeButtonEvent(asDisplay(display_), static_cast<unsigned>(button), False, CurrentTime);
    XSync(asDisplay(display_), False);
}

void Screen::keyDown(const std::string& name) {
    KeyCode code = XKeysymToKeycode(asDisplay(display_), XStringToKeysym(name.c_str()));
    XTestFakeKeyEvent(asDisplay(display_), code, True, CurrentTime);
    XSync(asDisplay(display_), False);
}

void Screen::keyUp(const std::string& name) {
    KeyCode code = XKeysymToKeycode(asDisplay(display_), XStringToKeysym(name.c_str()));
    XTestFakeKeyEvent(asDisplay(display_), code, False, CurrentTime);
    XSync(asDisplay(display_), False);
}

// The first child of the root that is more than a helper window of a toolkit.
unsigned long Screen::window() {
    ::Window root = 0, parent = 0, *children = nullptr, found = 0;
    unsigned count = 0;
    XQueryTree(asDisplay(display_), DefaultRootWindow(asDisplay(display_)), &root, &parent,
               &children, &count);
    for (unsigned i = 0; i < count && !found; ++i) {
        char* name = nullptr;
        if (XFetchName(asDisplay(display_), children[i], &name) && name) found = children[i];
        if (name) XFree(name);
    }
    if (children) XFree(children);
    if (!found) throw std::runtime_error("there is no window on the screen");
    return found;
}

std::string Screen::title() {
    char* name = nullptr;
    std::string title;
    if (XFetchName(asDisplay(display_), window(), &name) && name) title = name;
    if (name) XFree(name);
    return title;
}

Image Screen::icon() {
    // As many longs: width, height and pixels of A, R, G, B, one icon after the other.
    Display* display = asDisplay(display_);
    Atom type = 0;
    int format = 0;
    unsigned long count = 0, left = 0;
    unsigned char* bytes = nullptr;
    constexpr long kMost = 1 << 20;
    XGetWindowProperty(display, window(), XInternAtom(display, "_NET_WM_ICON", False), 0, kMost,
                       False, XA_CARDINAL, &type, &format, &count, &left, &bytes);
    Image largest;
    const auto* words = reinterpret_cast<const unsigned long*>(bytes);
    for (unsigned long at = 0; words && at + 2 < count; at += 2 + words[at] * words[at + 1]) {
        const int width = static_cast<int>(words[at]), height = static_cast<int>(words[at + 1]);
        if (width <= largest.width) continue;
        largest = Image(width, height, 4);
        for (size_t i = 0; i < largest.data.size() / 4; ++i)
            for (size_t c = 0; c < 4; ++c)
                largest.data[4 * i + c] =
                    static_cast<uint8_t>(words[at + 2 + i] >> (c == 3 ? 24 : 16 - 8 * c));
    }
    if (bytes) XFree(bytes);
    return largest;
}

void Screen::setDpi(int dpi) {
    const std::string resources = "Xft.dpi:\t" + std::to_string(dpi) + "\n";
    XChangeProperty(asDisplay(display_), DefaultRootWindow(asDisplay(display_)),
                    XA_RESOURCE_MANAGER, XA_STRING, 8, PropModeReplace,
                    reinterpret_cast<const unsigned char*>(resources.data()),
                    static_cast<int>(resources.size()));
    XSync(asDisplay(display_), False);
}

void Screen::resizeWindow(int width, int height) {
    XResizeWindow(asDisplay(display_), window(), static_cast<unsigned>(width),
                  static_cast<unsigned>(height));
    XSync(asDisplay(display_), False);
}

void Screen::hideWindow() {
    XUnmapWindow(asDisplay(display_), window());
    XSync(asDisplay(display_), False);
}

void Screen::closeWindow() {
    XClientMessageEvent message{};
    message.type = ClientMessage;
    message.window = window();
    message.message_type = XInternAtom(asDisplay(display_), "WM_PROTOCOLS", False);
    message.format = 32;
    message.data.l[0] =
        static_cast<long>(XInternAtom(asDisplay(display_), "WM_DELETE_WINDOW", False));
    message.data.l[1] = CurrentTime;
    XEvent event{};
    event.xclient = message;
    XSendEvent(asDisplay(display_), message.window, False, NoEventMask, &event);
    XSync(asDisplay(display_), False);
}

void Screen::showWindow() {
    XMapWindow(asDisplay(display_), window());
    XSync(asDisplay(display_), False);
}

// A message of XDND to the window, from the one that is dragged from.
void Screen::tell(unsigned long source, const char* name, long second, long third, long fourth,
                  long fifth) {
    XClientMessageEvent message{};
    message.type = ClientMessage;
    message.window = window();
    message.message_type = XInternAtom(asDisplay(display_), name, False);
    message.format = 32;
    const long values[] = {static_cast<long>(source), second, third, fourth, fifth};
    std::copy_n(values, 5, message.data.l);
    XEvent event{};
    event.xclient = message;
    XSendEvent(asDisplay(display_), message.window, False, NoEventMask, &event);
    XFlush(asDisplay(display_));
}

bool Screen::drop(const std::string& uriList, int x, int y,
                  const std::function<void()>& meanwhile) {
    Display* display = asDisplay(display_);
    const auto atom = [&](const char* name) { return XInternAtom(display, name, False); };
    const ::Window source =
        XCreateSimpleWindow(display, DefaultRootWindow(display), 0, 0, 1, 1, 0, 0, 0);
    const auto list = static_cast<long>(atom("text/uri-list"));
    XSetSelectionOwner(display, atom("XdndSelection"), source, CurrentTime);
    constexpr long kVersion = 5;
    tell(source, "XdndEnter", kVersion << 24, list, 0, 0);
    tell(source, "XdndPosition", 0, x << 16 | y, CurrentTime,
         static_cast<long>(atom("XdndActionCopy")));
    std::optional<bool> taken;
    constexpr int kMostTurns = 1000;
    for (int i = 0; i < kMostTurns && !taken; ++i) {
        meanwhile();
        while (!taken && XPending(display)) {
            XEvent event{};
            XNextEvent(display, &event);
            if (event.type == SelectionRequest) {
                const XSelectionRequestEvent& asked = event.xselectionrequest;
                XChangeProperty(display, asked.requestor, asked.property, asked.target, 8,
                                PropModeReplace,
                                reinterpret_cast<const unsigned char*>(uriList.data()),
                                static_cast<int>(uriList.size()));
                XEvent answer{};
                answer.xselection.type = SelectionNotify;
                answer.xselection.requestor = asked.requestor;
                answer.xselection.selection = asked.selection;
                answer.xselection.target = asked.target;
                answer.xselection.property = asked.property;
                answer.xselection.time = asked.time;
                XSendEvent(display, asked.requestor, False, NoEventMask, &answer);
            } else if (event.type == ClientMessage) {
                // GLFW says how many bytes it took where the protocol has a flag.
                const bool willing = event.xclient.data.l[1] != 0;
                if (event.xclient.message_type == atom("XdndFinished") || !willing)
                    taken = willing;
                else if (event.xclient.message_type == atom("XdndStatus"))
                    tell(source, "XdndDrop", 0, CurrentTime, 0, 0);
            }
        }
        XFlush(display);
    }
    XDestroyWindow(display, source);
    if (!taken) throw std::runtime_error("the window does not answer what is dropped");
    return *taken;
}

Image Screen::grab(int x, int y, int width, int height) {
    XImage* grabbed =
        XGetImage(asDisplay(display_), DefaultRootWindow(asDisplay(display_)), x, y,
                  static_cast<unsigned>(width), static_cast<unsigned>(height), AllPlanes, ZPixmap);
    if (!grabbed) throw std::runtime_error("the screen cannot be read");
    Image image(width, height, 3);
    for (int row = 0; row < height; ++row)
        for (int column = 0; column < width; ++column) {
            unsigned long pixel = XGetPixel(grabbed, column, row);
            uint8_t* rgb = image.pixel(column, row);
            rgb[0] = static_cast<uint8_t>(pixel >> 16);
            rgb[1] = static_cast<uint8_t>(pixel >> 8);
            rgb[2] = static_cast<uint8_t>(pixel);
        }
    XDestroyImage(grabbed);
    return image;
}

}  // namespace doppel::test
