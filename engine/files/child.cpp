#include "engine/files/child.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>

#include "engine/error.h"

namespace doppel {

namespace {

constexpr rlim_t kSeconds = 60, kBytes = rlim_t{4} << 30;
// The first byte that a child sends: what follows is its result, or an error's text.
enum : uint8_t { kResult, kError };

void lower(decltype(RLIMIT_CPU) resource, rlim_t to) {
    rlimit limit{};
    if (getrlimit(resource, &limit) != 0) return;
    limit.rlim_cur = std::min(limit.rlim_cur, to);
    setrlimit(resource, &limit);
}

void sendAll(int to, const void* data, size_t size) {
    const auto* bytes = static_cast<const uint8_t*>(data);
    while (size > 0) {
        const ssize_t sent = write(to, bytes, size);
        if (sent < 0 && errno == EINTR) continue;
        if (sent <= 0) _exit(1);
        bytes += sent, size -= size_t(sent);
    }
}

[[noreturn]] void runChild(int to, rlim_t bytes,
                           const std::function<std::vector<uint8_t>()>& work) {
    lower(RLIMIT_CPU, kSeconds);
    lower(RLIMIT_AS, bytes);
    lower(RLIMIT_CORE, 0);
    std::vector<uint8_t> message;
    uint8_t kind = kResult;
    try {
        message = work();
    } catch (const InputError& error) {
        kind = kError;
        message.assign(error.what(), error.what() + std::strlen(error.what()));
    } catch (...) {  // out of memory, say
        _exit(1);
    }
    sendAll(to, &kind, 1);
    sendAll(to, message.data(), message.size());
    _exit(0);
}

}  // namespace

std::vector<uint8_t> inChild(const std::string& where, const std::string& expected,
                             const std::function<std::vector<uint8_t>()>& work) {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0)
        throw MachineError(fmt::format("{}: pipe: {}", where, std::strerror(errno)));
    rlim_t pages = 0;
    std::ifstream("/proc/self/statm") >> pages;
    const rlim_t bytes = pages * rlim_t(sysconf(_SC_PAGESIZE)) + kBytes;
    const pid_t child = fork();
    if (child < 0) {
        close(ends[0]), close(ends[1]);
        throw MachineError(fmt::format("{}: fork: {}", where, std::strerror(errno)));
    }
    if (child == 0) runChild(ends[1], bytes, work);
    close(ends[1]);
    std::vector<uint8_t> message;
    std::vector<uint8_t> part(size_t{1} << 16);
    while (true) {
        const ssize_t count = read(ends[0], part.data(), part.size());
        if (count < 0 && errno == EINTR) continue;
        if (count <= 0 || message.size() > kBytes) break;
        message.insert(message.end(), part.begin(), part.begin() + count);
    }
    close(ends[0]);
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0 || message.empty())
        throwInput("{}: expected {}, found one that its reader does not survive", where, expected);
    const uint8_t kind = message.front();
    message.erase(message.begin());
    if (kind == kError) throw InputError(std::string(message.begin(), message.end()));
    return message;
}

}  // namespace doppel
