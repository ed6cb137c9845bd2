// JSON that anybody may have written.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "engine/error.h"

namespace doppel {

// The document; `what` is what was expected: "a pose". InputError that begins with `name` where the
// text is no JSON, has a number that is too large, or nests deeper than anything of ours: what
// copies, compares or prints a document calls itself for each level, until the stack ends.
inline nlohmann::json parsedJson(std::string_view text, const std::string& name, const char* what) {
    using nlohmann::json;
    constexpr int kDeepest = 8;
    const auto requireShallow = [&](int above, json::parse_event_t event, const json&) {
        const bool deeper =
            event == json::parse_event_t::array_start || event == json::parse_event_t::object_start;
        if (deeper && above >= kDeepest)
            throwInput("{}: expected {} of at most {} levels, found more", name, what, kDeepest);
        return true;
    };
    try {
        return json::parse(text, requireShallow);
    } catch (const json::parse_error& problem) {
        throwInput("{}: expected {} as JSON, found an error at byte {}", name, what, problem.byte);
    } catch (const json::out_of_range&) {
        // A number beyond the range of double.
        throwInput("{}: expected finite numbers, found one that is too large", name);
    }
}

}  // namespace doppel
