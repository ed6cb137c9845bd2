// Numbers of a preset, each declared once, with its default, range and meaning. A list
//
/*     #define SOME_NUMBERS(NUMBER, FLAG, CHOICE)                                              \
           NUMBER(int, batch, 8, 1, 256, "frames of a step")                                   \
           FLAG(dilateMask, false, "whether the mask grows by a pixel before the loss")        \
           CHOICE(Region, region, Union, "pixels that the loss counts")
       struct SomePreset {
           NUMBERS(SOME_NUMBERS)
       };
*/
// gives SomePreset the members `int batch = 8`, `bool dilateMask = false` and `Region region =
// Region::Union`, and each(preset, visit), which calls visit(NumberInfo, member) for every one of
// them in this order.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace doppel {

constexpr double kNoLimit = 1e9;

struct NumberInfo {
    std::string_view name;
    double lowest = 0, highest = 0;  // of a number, both included
    std::vector<std::string> words;  // of a choice: what it may be, by the enumerator's value
    std::string_view help;
};

// "Paper, Program" -> {"paper", "program"}.
inline std::vector<std::string> enumeratorWords(std::string_view enumerators) {
    std::vector<std::string> words(1);
    for (char c : enumerators) {
        if (c == ',')
            words.emplace_back();
        else if (c >= 'A' && c <= 'Z')
            words.back() += static_cast<char>(c - 'A' + 'a');
        else if (c != ' ')
            words.back() += c;
    }
    return words;
}

// The enumerators, from 0 on, whose names in lower case are an enum's words in files and flags.
#define CHOICE_WORDS(Type, ...) \
    inline std::vector<std::string> wordsOf(Type) { return enumeratorWords(#__VA_ARGS__); }
// The enum with its words.
#define CHOICES(Type, ...)           \
    enum class Type { __VA_ARGS__ }; \
    CHOICE_WORDS(Type, __VA_ARGS__)

#define NUMBER_MEMBER(type, name, value, lowest, highest, help) type name = value;
#define FLAG_MEMBER(name, value, help) bool name = value;
#define CHOICE_MEMBER(Type, name, value, help) Type name = Type::value;

#define NUMBER_VISIT(type, name, value, lowest, highest, help) \
    visit(NumberInfo{#name, lowest, highest, {}, help}, preset.name);
#define FLAG_VISIT(name, value, help) visit(NumberInfo{#name, 0, 1, {}, help}, preset.name);
#define CHOICE_VISIT(Type, name, value, help) \
    visit(NumberInfo{#name, 0, 0, wordsOf(Type{}), help}, preset.name);

#define NUMBERS(LIST)                                \
    LIST(NUMBER_MEMBER, FLAG_MEMBER, CHOICE_MEMBER)  \
    template <typename Preset, typename Visit>       \
    static void each(Preset& preset, Visit visit) {  \
        LIST(NUMBER_VISIT, FLAG_VISIT, CHOICE_VISIT) \
    }

}  // namespace doppel
