// Three kinds of failure, kept apart: the user's mistake, the machine's refusal, our own bug.
#pragma once

#include <fmt/format.h>

#include <stdexcept>
#include <string>
#include <utility>

namespace doppel {

// The input or the flags are wrong: exit 2. One line: file, field, expected, found, what to do.
struct InputError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// The machine refuses (no device, no memory, no space, no permission to write): exit 1.
struct MachineError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

template <typename... Args>
[[noreturn]] void throwInput(fmt::format_string<Args...> format, Args&&... args) {
    throw InputError(fmt::format(format, std::forward<Args>(args)...));
}

template <typename... Args>
[[noreturn]] void throwMachine(fmt::format_string<Args...> format, Args&&... args) {
    throw MachineError(fmt::format(format, std::forward<Args>(args)...));
}

// Prints the place and the sentence to stderr and aborts: a broken promise between our own parts.
[[noreturn]] void checkFailed(const char* file, int line, const char* condition,
                              const std::string& sentence);

// The sentence (a fmt format and its arguments) says what should hold. On in every build.
#define CHECK(condition, ...)                                                                  \
    do {                                                                                       \
        if (!(condition)) [[unlikely]]                                                         \
            ::doppel::checkFailed(__FILE__, __LINE__, #condition, ::fmt::format(__VA_ARGS__)); \
    } while (0)

}  // namespace doppel
