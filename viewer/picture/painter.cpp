#include "viewer/picture/painter.h"
#include "trainer/avatar/avatar_renderer.h"

#include <chrono>

namespace doppel {

Painter::Painter(const Avatar& avatar, DeviceOptions device, std::function<void()> finished)
    : avatar_(avatar),
      deviceOptions_(std::move(device)),
      finished_(std::move(finished)),
      thread_([this] { work(); }) {}

Painter::~Painter() {
    {
        std::lock_guard lock(mutex_);
        stop_ = true;
    }
    wake_.notify_one();
    thread_.join();
}

void Painter::ask(TextureKind kind, std::vector<float> verts, uint64_t version) {
    {
        std::lock_guard lock(mutex_);
        wish_ = Wish{kind, std::move(verts), version};
    }
    wake_.notify_one();
}

std::optional<Painter::Painting> Painter::take() {
    std::lock_guard lock(mutex_);
    if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
    return std::exchange(painting_, std::nullopt);
}

bool Painter::busy() {
    std::lock_guard lock(mutex_);
    return wish_ || working_ || painting_ || failure_;
}

void Painter::work() {
    std::unique_ptr<Device> device;
    std::map<TextureKind, std::unique_ptr<AvatarRenderer>> renderers;
    std::unique_lock lock(mutex_);
    while (true) {
        wake_.wait(lock, [this] { return wish_.has_value() || stop_; });
        if (stop_) return;
        Wish wish = std::move(*wish_);
        wish_.reset();
        working_ = true;
        lock.unlock();
        std::optional<Painting> painting;
        std::exception_ptr failure;
        try {
            auto before = std::chrono::steady_clock::now();
            if (!device) device = std::make_unique<Device>(deviceOptions_);
            auto& renderer = renderers[wish.kind];
            if (!renderer)
                renderer = std::make_unique<AvatarRenderer>(*device, avatar_, false, wish.kind);
            painting = {wish.kind, wish.version, renderer->texture(wish.verts), 0};
            painting->seconds =
                std::chrono::duration<double>(std::chrono::steady_clock::now() - before).count();
        } catch (...) {
            failure = std::current_exception();
        }
        lock.lock();
        working_ = false;
        if (painting) painting_ = std::move(painting);
        failure_ = failure;
        lock.unlock();
        finished_();
        lock.lock();
    }
}

}  // namespace doppel
