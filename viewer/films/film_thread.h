// Draws a film in the background, with a device of its own.
#pragma once

#include <atomic>
#include <exception>
#include <functional>
#include <mutex>
#include <optional>
#include <thread>

#include "engine/io/image.h"
#include "viewer/films/film_plan.h"

namespace doppel {

class FilmThread {
public:
    // progressed() is called from the thread after each picture and at the end.
    FilmThread(FilmPlan plan, std::function<void()> progressed);
    // Gives up what has not ended; nothing of it is left.
    ~FilmThread();
    FilmThread(const FilmThread&) = delete;
    FilmThread& operator=(const FilmThread&) = delete;

    const std::filesystem::path& out() const { return plan_.out; }
    bool isPicture() const { return isPicture_; }
    // Part of the frames that are drawn.
    float progress() const;
    bool ended() const { return ended_; }
    // Once it has ended: throws what went wrong.
    void finish();
    // The picture that was drawn last, R, G, B, at most kPreview pixels wide and high; nothing
    // where there is none since the last time.
    static constexpr int kPreview = 400;
    std::optional<Image> latest();

private:
    void work();
    void draw();

    FilmPlan plan_;
    const bool isPicture_;
    std::function<void()> progressed_;
    std::atomic<size_t> drawn_ = 0;
    std::atomic<bool> stop_ = false, ended_ = false;
    std::exception_ptr failure_;  // read once it has ended
    std::mutex mutex_;
    std::optional<Image> latest_;
    std::thread thread_;  // last: it uses all the others
};

}  // namespace doppel
