// JSON that anybody may have written.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

#include "engine/error.h"
#include "engine/files/json_depth.h"

namespace doppel {

// The document; `what` is what was expected: "a pose". InputError that begins with `name` where the
// text is no JSON, has a number that is too large, or nests deeper than anything of ours.
inline nlohmann::json parsedJson(std::string_view text, const std::string& name, const char* what) {
    using nlohmann::json;
    constexpr size_t kDeepest = 8;
    requireShallowJson(text, name, kDeepest);
    try {
        return json::parse(text);
    } catch (const json::parse_error& problem) {
        throwInput("{}: expected {} as JSON, found an error at byte {}", name, what, problem.byte);
    } catch (const json::out_of_range&) {
        // A number beyond the range of double.
        throwInput("{}: expected finite numbers, found one that is too large", name);
    }
}

}  // namespace doppel
