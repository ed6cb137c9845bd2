// Paints an avatar's texture for a view in the background, so that the window never waits for it.
#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "engine/device.h"
#include "trainer/avatar/avatar.h"

namespace doppel {

// A thread with a device of its own: the texture networks take a second or more on a CPU.
class Painter {
public:
    struct Painting {
        TextureKind kind;
        uint64_t version;            // as it was asked for
        std::vector<float> texture;  // [size,size,3] sRGB-encoded in [0,1]
        double seconds;              // that it took
    };

    // device: the painter's own is made of it. finished() is called from the thread after each
    // painting. The avatar outlives the painter.
    Painter(const Avatar& avatar, DeviceOptions device, std::function<void()> finished);
    ~Painter();
    Painter(const Painter&) = delete;
    Painter& operator=(const Painter&) = delete;

    // The texture for vertices in camera space. A wish that was not begun yet is forgotten.
    void ask(TextureKind kind, std::vector<float> verts, uint64_t version);
    // The newest painting that was not taken yet. Throws what went wrong in the thread.
    std::optional<Painting> take();
    // Whether a wish waits, is being painted, or has a painting that was not taken.
    bool busy();

private:
    struct Wish {
        TextureKind kind;
        std::vector<float> verts;
        uint64_t version;
    };
    void work();

    const Avatar& avatar_;
    DeviceOptions deviceOptions_;
    std::function<void()> finished_;
    std::mutex mutex_;
    std::condition_variable wake_;
    std::optional<Wish> wish_;
    std::optional<Painting> painting_;
    std::exception_ptr failure_;
    bool working_ = false, stop_ = false;
    std::thread thread_;  // last: it uses all the others
};

}  // namespace doppel
