#include "engine/files/printable.h"

namespace doppel {

std::string printable(std::string_view text, size_t limit) {
    std::string result(text.substr(0, limit));
    for (char& c : result) {
        if (static_cast<unsigned char>(c) < ' ' || c == 127) c = '?';
    }
    return text.size() > limit ? result + "…" : result;
}

}  // namespace doppel
