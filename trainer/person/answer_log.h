// What slow functions answered, on disk: a run that was stopped need not ask them again.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <span>
#include <type_traits>
#include <unordered_map>
#include <vector>

#include "trainer/data/digest.h"

namespace doppel {

// Answers by their questions, in a file that grows and is read again by the next run. A question is
// a Digest of all that its answer depends on.
class AnswerLog {
public:
    using Answer = std::vector<std::byte>;

    // The file is begun, or gone on with: a record that a killed run left half written is cut off.
    // MachineError where it cannot be written.
    explicit AnswerLog(std::filesystem::path file);

    // take() gets the answer that is kept, and says whether it can be used; where there is none, or
    // it cannot, ask() is called, which uses what it finds itself, and its answer is kept.
    using Take = std::function<bool(std::span<const std::byte>)>;
    using Ask = std::function<Answer()>;
    void operator()(const Digest& question, const Take& take, const Ask& ask);

    size_t kept() const { return records_.size(); }

private:
    struct Record {
        uint64_t at, size, check;
    };
    void read();
    Answer answerOf(const Record& record);

    std::filesystem::path path_;
    std::fstream file_;
    uint64_t end_ = 0;
    std::unordered_map<uint64_t, Record> records_;
};

// The same where there may be no log: ask() then.
inline void answer(AnswerLog* log, const Digest& question, const AnswerLog::Take& take,
                   const AnswerLog::Ask& ask) {
    if (log)
        (*log)(question, take, ask);
    else
        ask();
}

// Values one after the other.
template <typename T>
void append(AnswerLog::Answer& answer, std::span<const T> values) {
    static_assert(std::is_trivially_copyable_v<T>);
    const size_t before = answer.size();
    answer.resize(before + values.size_bytes());
    if (!values.empty()) std::memcpy(answer.data() + before, values.data(), values.size_bytes());
}
template <typename T>
void append(AnswerLog::Answer& answer, const T& value) {
    append(answer, std::span<const T>(&value, 1));
}

// As many values as there is room for, off the front; false where there are fewer bytes.
template <typename T>
bool takeFront(std::span<const std::byte>& answer, std::span<T> values) {
    static_assert(std::is_trivially_copyable_v<T>);
    if (answer.size() < values.size_bytes()) return false;
    if (!values.empty()) std::memcpy(values.data(), answer.data(), values.size_bytes());
    answer = answer.subspan(values.size_bytes());
    return true;
}
template <typename T>
bool takeFront(std::span<const std::byte>& answer, T& value) {
    return takeFront(answer, std::span<T>(&value, 1));
}

}  // namespace doppel
