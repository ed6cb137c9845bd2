#include "engine/files/json_depth.h"

#include "engine/error.h"

namespace doppel {

void requireShallowJson(std::string_view text, const std::string& where, size_t most) {
    size_t depth = 0;
    bool inString = false;
    for (size_t i = 0; i < text.size(); ++i) {
        const char c = text[i];
        if (c == '"') {
            inString = !inString;
        } else if (inString) {
            if (c == '\\') ++i;
        } else if (c == '[' || c == '{') {
            if (++depth > most)
                throwInput("{}: expected JSON nested at most {} deep, found more at byte {}", where,
                           most, i);
        } else if ((c == ']' || c == '}') && depth > 0) {
            --depth;
        }
    }
}

}  // namespace doppel
