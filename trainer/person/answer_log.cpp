#include "trainer/person/answer_log.h"

#include <array>

#include "engine/error.h"

namespace doppel {
namespace fs = std::filesystem;

namespace {

// Question, bytes and check of a record; then the bytes.
using Head = std::array<uint64_t, 3>;

uint64_t checkOf(std::span<const std::byte> answer) {
    Digest digest;
    digest.add(answer);
    return digest.value();
}

}  // namespace

AnswerLog::AnswerLog(fs::path file) : path_(std::move(file)) {
    read();
    std::error_code error;
    if (fs::exists(path_, error))
        fs::resize_file(path_, end_, error);
    else
        std::ofstream(path_, std::ios::binary).flush();
    file_.open(path_, std::ios::binary | std::ios::in | std::ios::out);
    if (error || !file_) throwMachine("{}: cannot be written", path_.string());
}

void AnswerLog::read() {
    std::error_code error;
    const uint64_t length = fs::exists(path_, error) ? fs::file_size(path_, error) : 0;
    std::ifstream file(path_, std::ios::binary);
    Head head;
    while (!error && file && length - end_ >= sizeof(head)) {
        file.seekg(std::streamoff(end_));
        if (!file.read(reinterpret_cast<char*>(head.data()), sizeof(head))) return;
        const auto [question, size, check] = head;
        if (size > length - end_ - sizeof(head)) return;
        records_[question] = {end_ + sizeof(head), size, check};
        end_ += sizeof(head) + size;
    }
}

AnswerLog::Answer AnswerLog::answerOf(const Record& record) {
    Answer answer(record.size);
    file_.clear();
    file_.seekg(std::streamoff(record.at));
    file_.read(reinterpret_cast<char*>(answer.data()), std::streamsize(record.size));
    if (!file_ || checkOf(answer) != record.check) answer.clear();
    return answer;
}

void AnswerLog::operator()(const Digest& question, const Take& take, const Ask& ask) {
    if (const auto known = records_.find(question.value()); known != records_.end()) {
        const Answer answer = answerOf(known->second);
        if (answer.size() == known->second.size && take(answer)) return;
    }
    const Answer answer = ask();
    const Head head{question.value(), answer.size(), checkOf(answer)};
    file_.clear();
    file_.seekp(std::streamoff(end_));
    file_.write(reinterpret_cast<const char*>(head.data()), sizeof(head));
    file_.write(reinterpret_cast<const char*>(answer.data()), std::streamsize(answer.size()));
    file_.flush();
    if (!file_) throwMachine("{}: cannot be written; is the disk full?", path_.string());
    records_[question.value()] = {end_ + sizeof(head), answer.size(), head[2]};
    end_ += sizeof(head) + answer.size();
}

}  // namespace doppel
