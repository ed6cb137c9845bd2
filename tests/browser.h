// A page in Debian's chromium without a window, led through its DevTools protocol, which it speaks
// over two pipes: https://chromedevtools.github.io/devtools-protocol
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "engine/io/image.h"
#include "tests/files.h"

namespace doppel::test {

// chromium's path; empty where it is not installed.
inline std::string chromium() {
    const char* variable = std::getenv("PATH");
    std::string folders = variable ? variable : "";
    for (size_t at = 0; at <= folders.size();) {
        const size_t end = std::min(folders.find(':', at), folders.size());
        const std::string path = folders.substr(at, end - at) + "/chromium";
        if (access(path.c_str(), X_OK) == 0) return path;
        at = end + 1;
    }
    return {};
}

inline constexpr std::string_view kDigits =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

inline std::vector<uint8_t> fromBase64(std::string_view text) {
    std::vector<uint8_t> bytes;
    uint32_t group = 0;
    int bits = 0;
    for (const char c : text) {
        const size_t digit = kDigits.find(c);
        if (digit == std::string_view::npos) break;
        group = group << 6 | static_cast<uint32_t>(digit);
        bits += 6;
        if (bits < 8) continue;
        bits -= 8;
        bytes.push_back(static_cast<uint8_t>(group >> bits & 255));
    }
    return bytes;
}

inline std::string toBase64(std::string_view bytes) {
    std::string text;
    uint32_t group = 0;
    int bits = 0;
    for (const char c : bytes) {
        group = group << 8 | static_cast<uint8_t>(c);
        for (bits += 8; bits >= 6; bits -= 6) text += kDigits[group >> (bits - 6) & 63];
    }
    if (bits > 0) text += kDigits[group << (6 - bits) & 63];
    while (text.size() % 4) text += '=';
    return text;
}

class Browser {
public:
    using Json = nlohmann::json;
    static constexpr const char* kServer = "http://avatar.test/";

    // `served`: the folder that kServer shows; no other server is reached.
    Browser(int width, int height, std::filesystem::path served = {}) : served_(std::move(served)) {
        start();
        const Json target = call("Target.createTarget", {{"url", "about:blank"}});
        session_ =
            call("Target.attachToTarget", {{"targetId", target.at("targetId")}, {"flatten", true}})
                .at("sessionId");
        for (const char* domain : {"Page", "Runtime", "Log", "Network"})
            call(std::string(domain) + ".enable");
        call("Fetch.enable", {{"patterns", {{{"urlPattern", std::string(kServer) + "*"}}}}});
        size(width, height);
        theme("light");
    }
    ~Browser() {
        // The program's children are in its group.
        kill(-child_, SIGKILL);
        waitpid(child_, nullptr, 0);
        close(to_);
        close(from_);
    }
    Browser(const Browser&) = delete;
    Browser& operator=(const Browser&) = delete;

    void size(int width, int height) {
        call("Emulation.setDeviceMetricsOverride",
             {{"width", width}, {"height", height}, {"deviceScaleFactor", 1}, {"mobile", false}});
    }
    // What the system's settings ask for: "light" or "dark", "no-preference" or "reduce".
    void theme(const char* colours, const char* motion = "no-preference") {
        call("Emulation.setEmulatedMedia",
             {{"features",
               {{{"name", "prefers-color-scheme"}, {"value", colours}},
                {{"name", "prefers-reduced-motion"}, {"value", motion}}}}});
    }
    void open(const std::string& address) {
        loaded_ = false;
        call("Page.navigate", {{"url", address}});
        while (!loaded_) take(receive());
    }
    // What an expression comes to, promises awaited.
    Json value(const std::string& expression) {
        const Json answer =
            call("Runtime.evaluate",
                 {{"expression", expression}, {"awaitPromise", true}, {"returnByValue", true}});
        if (answer.contains("exceptionDetails"))
            throw std::runtime_error(expression + ": " + answer.at("exceptionDetails").dump());
        return answer.at("result").value("value", Json());
    }
    void mouse(const char* type, double x, double y) {
        call("Input.dispatchMouseEvent", {{"type", type},
                                          {"x", x},
                                          {"y", y},
                                          {"button", "left"},
                                          {"buttons", 1},
                                          {"clickCount", 1}});
    }
    void click(double x, double y) {
        mouse("mousePressed", x, y);
        mouse("mouseReleased", x, y);
    }
    void touch(const char* type, double x, double y) {
        Json points = Json::array();
        if (std::string_view(type) != "touchEnd") points.push_back({{"x", x}, {"y", y}});
        call("Input.dispatchTouchEvent", {{"type", type}, {"touchPoints", points}});
    }
    void key(const char* name, int code) {
        for (const char* type : {"rawKeyDown", "keyUp"})
            call("Input.dispatchKeyEvent",
                 {{"type", type}, {"key", name}, {"code", name}, {"windowsVirtualKeyCode", code}});
    }
    std::vector<uint8_t> screenshot() {
        return fromBase64(call("Page.captureScreenshot", {{"format", "png"}})
                              .at("data")
                              .get_ref<const std::string&>());
    }
    Image picture() { return decodeImage(screenshot(), "screenshot"); }

    // Errors and warnings on the console, and addresses outside of files and kServer.
    std::vector<std::string> complaints;

private:
    void start() {
        int in[2], out[2];
        if (pipe2(in, O_CLOEXEC) != 0 || pipe2(out, O_CLOEXEC) != 0) std::abort();
        const std::string program = chromium(),
                          home = "--user-data-dir=" + (home_ / "profile").string();
        std::vector<std::string> words = {
            program, "--headless=new", "--remote-debugging-pipe", "--no-sandbox", home,
            // Without a GPU.
            "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
            // It asks nobody for anything.
            "--no-first-run", "--disable-background-networking", "--disable-component-update",
            "--disable-sync", "--disable-default-apps", "--disable-dev-shm-usage",
            "--disable-crash-reporter", "--host-resolver-rules=MAP * ~NOTFOUND", "about:blank"};
        std::vector<char*> arguments;
        for (std::string& word : words) arguments.push_back(word.data());
        arguments.push_back(nullptr);
        const std::string log = (home_ / "log").string(), folder = home_.path().string();
        child_ = fork();
        if (child_ == 0) {
            setpgid(0, 0);
            setenv("HOME", folder.c_str(), 1);
            // Its own driver, and none that tests of ours are told to take.
            unsetenv("VK_DRIVER_FILES");
            unsetenv("VK_ICD_FILENAMES");
            // Beyond 3 and 4 first, lest one of them be in the place of another.
            const int read = fcntl(in[0], F_DUPFD, 10), write = fcntl(out[1], F_DUPFD, 10);
            dup2(read, 3);
            dup2(write, 4);
            close(read);
            close(write);
            if (!freopen(log.c_str(), "w", stderr) || !freopen("/dev/null", "w", stdout))
                _exit(126);
            execv(program.c_str(), arguments.data());
            _exit(127);
        }
        setpgid(child_, child_);
        close(in[0]);
        close(out[1]);
        to_ = in[1];
        from_ = out[0];
    }

    Json call(const std::string& method, const Json& parameters = Json::object()) {
        const int id = post(method, parameters);
        while (true) {
            const Json message = receive();
            if (message.value("id", -1) == id) {
                if (message.contains("error"))
                    throw std::runtime_error(method + ": " + message.at("error").dump());
                return message.at("result");
            }
            take(message);
        }
    }

    int post(const std::string& method, const Json& parameters) {
        Json message = {{"id", ++last_}, {"method", method}, {"params", parameters}};
        if (!session_.empty()) message["sessionId"] = session_;
        std::string text = message.dump();
        text.push_back('\0');
        for (size_t sent = 0; sent < text.size();) {
            const ssize_t count = write(to_, text.data() + sent, text.size() - sent);
            if (count <= 0) fail("hears nothing");
            sent += static_cast<size_t>(count);
        }
        return last_;
    }

    Json receive() {
        size_t end = heard_.find('\0');
        while (end == std::string::npos) {
            // Nothing takes as long on any machine: it hangs.
            constexpr int kPatience = 180000;
            pollfd ready{from_, POLLIN, 0};
            if (poll(&ready, 1, kPatience) <= 0) fail("says nothing");
            char part[65536];
            const ssize_t count = read(from_, part, sizeof part);
            if (count <= 0) fail("has ended");
            const size_t before = heard_.size();
            heard_.append(part, static_cast<size_t>(count));
            end = heard_.find('\0', before);
        }
        Json message = Json::parse(heard_.substr(0, end));
        heard_.erase(0, end + 1);
        return message;
    }

    [[noreturn]] void fail(const char* what) const {
        throw std::runtime_error(std::string("chromium ") + what + ": " + bytesOf(home_ / "log"));
    }

    // Events, and answers that nobody waits for.
    void take(const Json& message) {
        const std::string method = message.value("method", "");
        const Json parameters = message.value("params", Json::object());
        if (method == "Page.loadEventFired") loaded_ = true;
        if (method == "Fetch.requestPaused") serve(parameters);
        if (method == "Runtime.exceptionThrown") complaints.push_back(parameters.dump());
        if (method == "Runtime.consoleAPICalled" && parameters.at("type") != "log")
            complaints.push_back(parameters.dump());
        if (method == "Log.entryAdded" && parameters.at("entry").at("level") != "verbose")
            complaints.push_back(parameters.dump());
        if (method == "Network.requestWillBeSent") {
            const std::string address = parameters.at("request").at("url");
            bool known = false;
            for (const char* start : {kServer, "file:", "data:", "blob:", "about:"})
                known = known || address.starts_with(start);
            if (!known) complaints.push_back("asks for " + address);
        }
    }

    void serve(const Json& request) {
        std::string name = request.at("request").at("url");
        name = name.substr(std::string_view(kServer).size());
        if (name.empty()) name = "index.html";
        const std::filesystem::path file = served_ / name;
        std::error_code error;
        const bool there = std::filesystem::is_regular_file(file, error);
        const std::string ending = file.extension();
        const char* type = ending == ".html" ? "text/html"
                           : ending == ".js" ? "text/javascript"
                                             : "application/octet-stream";
        post("Fetch.fulfillRequest",
             {{"requestId", request.at("requestId")},
              // Browsers ask every server for an icon.
              {"responseCode", there                   ? 200
                               : name == "favicon.ico" ? 204
                                                       : 404},
              {"responseHeaders", {{{"name", "Content-Type"}, {"value", type}}}},
              {"body", there ? toBase64(bytesOf(file)) : ""}});
    }

    std::filesystem::path served_;
    Folder home_;
    pid_t child_ = -1;
    int to_ = -1, from_ = -1, last_ = 0;
    std::string session_, heard_;
    bool loaded_ = false;
};

}  // namespace doppel::test
