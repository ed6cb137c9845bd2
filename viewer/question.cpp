#include "viewer/question.h"

#include <GLFW/glfw3.h>
#include <imgui.h>

#include <algorithm>

#include "engine/error.h"
#include "viewer/widgets.h"

namespace doppel {

std::vector<std::string> QuestionBox::answers() const {
    std::vector<std::string> labels;
    if (question_)
        for (const Answer& answer : question_->answers) labels.push_back(answer.label);
    return labels;
}

std::function<void()> QuestionBox::take(const std::string& label) {
    CHECK(question_, "there is a question to answer with \"{}\"", label);
    auto found = std::ranges::find(question_->answers, label, &Answer::label);
    CHECK(found != question_->answers.end(), "\"{}\" is one of the answers", label);
    std::function<void()> then = std::move(found->then);
    question_.reset();
    return then;
}

std::optional<std::string> QuestionBox::answerOf(const KeyPress& press) const {
    // Whoever still holds a key has not read the question.
    if (!question_ || press.repeated) return {};
    if (press.key == GLFW_KEY_ENTER || press.key == GLFW_KEY_KP_ENTER)
        return question_->answers.front().label;
    if (press.key == GLFW_KEY_ESCAPE) return question_->answers.back().label;
    return {};
}

bool QuestionBox::appears() const {
    // Dear ImGui darkens what is behind it little by little.
    return open_ && std::chrono::steady_clock::now() - since_ < std::chrono::milliseconds(300);
}

std::optional<std::string> QuestionBox::draw(double unit) {
    if (!question_ && !open_) return {};
    constexpr const char* kName = "Doppel asks";
    if (!open_) {
        ImGui::OpenPopup(kName);
        since_ = std::chrono::steady_clock::now();
    }
    open_ = true;
    const ImVec2 size = ImGui::GetIO().DisplaySize;
    const auto pixel = static_cast<float>(unit);
    ImGui::SetNextWindowPos({size.x / 2, size.y / 2}, ImGuiCond_Always, {.5f, .5f});
    std::optional<std::string> chosen;
    if (!ImGui::BeginPopupModal(kName, nullptr,
                                ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoMove |
                                    ImGuiWindowFlags_NoSavedSettings))
        return {};
    if (question_) {
        ImGui::PushTextWrapPos(std::min(420 * pixel, size.x - 40 * pixel));
        ImGui::TextUnformatted(question_->text.c_str());
        ImGui::PopTextWrapPos();
        ImGui::Spacing();
        for (size_t i = 0; i < question_->answers.size(); ++i) {
            if (i > 0) ImGui::SameLine();
            const Answer& answer = question_->answers[i];
            if (button(answer.label.c_str(), answer.does)) chosen = answer.label;
        }
    } else {
        // It was answered. Dear ImGui takes what is no longer drawn for open all the same.
        ImGui::CloseCurrentPopup();
        open_ = false;
    }
    ImGui::EndPopup();
    return chosen;
}

}  // namespace doppel
