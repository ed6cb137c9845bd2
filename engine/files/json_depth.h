// How deep JSON of strangers is nested, before a parser sees it.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace doppel {

// InputError that starts with `where` if brackets outside of strings are nested deeper than `most`:
// parsers' values are copied and converted by functions that call themselves, once for each level.
// Whether it is JSON at all is not looked at.
void requireShallowJson(std::string_view text, const std::string& where, size_t most = 64);

}  // namespace doppel
