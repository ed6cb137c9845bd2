#include "viewer/live/making.h"

#include <signal.h>

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/error.h"
#include "engine/io/video.h"
#include "trainer/data/frame_selection.h"
#include "trainer/data/output_folder.h"

namespace doppel {
namespace fs = std::filesystem;

bool Making::takes(const fs::path& clip) {
    std::error_code error;
    if (fs::exists(clip / "capture.toml", error)) return false;  // whose pictures tell of it
    if (fs::is_directory(clip, error)) return !picturesOfFolder(clip).empty();
    try {
        return VideoReader(clip).duration() > 0;
    } catch (const std::exception&) {
        return false;
    }
}

fs::path Making::folderOf(const fs::path& clip) {
    const fs::path whole = fs::absolute(clip / "").parent_path();  // without a slash at its end
    return whole.parent_path() / (whole.stem().string() + "-avatar");
}

Making::Making(const fs::path& program, fs::path clip, const std::string& device)
    : clip_(std::move(clip)), line_("starts") {
    const fs::path own = program.empty() ? fs::read_symlink("/proc/self/exe") : program;
    std::vector<std::string> words{own.string(), "avatar", fs::absolute(clip_).string(), "--out",
                                   folderOf(clip_).string()};
    if (!device.empty()) words.insert(words.end(), {"--device", device});
    std::error_code ignored;
    if (!fs::is_regular_file(own, ignored))  // nor is a folder made for it
        throwMachine("{} cannot be started: it is not there any more; start the window anew",
                     own.string());
    constexpr const char* kLog = "log.txt";
    claimFiles(folderOf(clip_), "person", {kLog});
    // Who looks at its line wants to see it move.
    process_.start(std::move(words), folderOf(clip_) / kLog, {"DOPPEL_PROGRESS=2"});
}

bool Making::update() {
    if (status_) return false;
    status_ = process_.ended();
    unread_ += process_.said();
    std::string before = line_;
    for (size_t end; (end = unread_.find('\n')) != std::string::npos;) {
        if (end > 0) line_ = unread_.substr(0, end);
        unread_.erase(0, end + 1);
    }
    constexpr size_t kLongest = 4096;  // who never ends a line does not fill the memory
    if (unread_.size() > kLongest) unread_.clear();
    constexpr std::string_view kName = "doppel: ";  // before what went wrong
    if (line_.starts_with(kName)) line_.erase(0, kName.size());
    if (status_ > 128 && !stops_)
        line_ = fmt::format("{}: killed by signal {}; dropped again it goes on from there",
                            clip_.filename().string(), *status_ - 128);
    return status_ || line_ != before;
}

std::string Making::brief() const {
    constexpr std::string_view kBetween = "  ";  // what a line of progress has
    const size_t first = line_.find(kBetween), last = line_.rfind(kBetween);
    if (first == std::string::npos) return line_;
    return line_.substr(0, first) + ", " + line_.substr(last + kBetween.size());
}

std::optional<double> Making::share() const {
    const std::string line = line_.substr(0, line_.find("  "));
    const size_t space = line.rfind(' ');
    long long done = 0, total = 0;
    int used = 0;
    if (space == std::string::npos ||
        std::sscanf(line.c_str() + space, " %lld/%lld%n", &done, &total, &used) != 2 ||
        space + static_cast<size_t>(used) != line.size() || total <= 0)
        return {};
    return std::clamp(static_cast<double>(done) / static_cast<double>(total), 0., 1.);
}

void Making::stop() {
    stops_ = true;
    process_.send(SIGINT);
}

std::string Making::ending() const {
    if (*status_ == 0) return fmt::format("avatar in {}", avatar().string());
    if (!stops_) throwInput("{}", line_);
    return fmt::format("{}: stopped; dropped again it goes on from there",
                       clip_.filename().string());
}

Question questionToMake(const fs::path& clip, std::function<void()> make) {
    const fs::path folder = Making::folderOf(clip);
    std::error_code ignored;
    return {fmt::format("An avatar of the person in {} goes into {}, which takes minutes. The "
                        "window shows it as soon as there is something to see.{}",
                        clip.filename().string(), folder.string(),
                        fs::exists(folder, ignored) ? " What was begun there goes on." : ""),
            {{"Make it", std::move(make), "Runs `doppel avatar` beside the window."},
             {"Cancel", {}, "Leaves all as it is."}}};
}

Question questionToLeave(const Making& making, std::function<void()> stopAndClose,
                         std::function<void()> close) {
    return {fmt::format("An avatar of {} is being made: {}.", making.clip().filename().string(),
                        making.brief()),
            {{"Stop it, and close", std::move(stopAndClose),
              "What is done stays: the clip, dropped again, goes on from there."},
             {"Let it go on, and close", std::move(close), "It is finished without the window."},
             {"Cancel", {}, "The window stays open."}}};
}

}  // namespace doppel
