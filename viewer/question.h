// What a window asks in its middle. Nothing else is done until it is answered.
#pragma once

#include <chrono>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "viewer/window/window.h"

namespace doppel {

struct Answer {
    std::string label;
    std::function<void()> then;
    std::string does = {};  // the tip's
};
struct Question {
    std::string text;
    std::vector<Answer> answers;  // Enter gives the first, Escape the last
};

class QuestionBox {
public:
    // In the place of another.
    void ask(Question question) { question_ = std::move(question); }
    explicit operator bool() const { return question_.has_value(); }
    // Empty: nothing is asked.
    std::string text() const { return question_ ? question_->text : std::string(); }
    std::vector<std::string> answers() const;
    // The question is gone; what the answer does is the caller's to do, and may ask again. CHECKs
    // that it is offered.
    std::function<void()> take(const std::string& label);
    // The label of the answer that a key gives, if any.
    std::optional<std::string> answerOf(const KeyPress& press) const;
    // Within a frame of Dear ImGui, unit as Window::unit(): the label that was clicked on.
    std::optional<std::string> draw(double unit);
    // Whether what is behind it still darkens.
    bool appears() const;

private:
    std::optional<Question> question_;
    bool open_ = false;  // as Dear ImGui has it
    std::chrono::steady_clock::time_point since_{};
};

}  // namespace doppel
