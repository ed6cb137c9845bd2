#include "trainer/data/frame_selection.h"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <optional>

#include "engine/error.h"
#include "engine/files/ending.h"

namespace doppel {

bool naturallyBefore(const std::string& a, const std::string& b) {
    const auto digit = [](char c) { return c >= '0' && c <= '9'; };
    size_t i = 0, j = 0;
    while (i < a.size() && j < b.size()) {
        if (digit(a[i]) && digit(b[j])) {
            const auto run = [&](const std::string& s, size_t& at) {
                while (at < s.size() && s[at] == '0') ++at;
                const size_t begin = at;
                while (at < s.size() && digit(s[at])) ++at;
                return std::string_view(s).substr(begin, at - begin);
            };
            const std::string_view x = run(a, i), y = run(b, j);
            if (x.size() != y.size()) return x.size() < y.size();
            if (x != y) return x < y;
        } else {
            if (a[i] != b[j]) return a[i] < b[j];
            ++i, ++j;
        }
    }
    if (a.size() - i != b.size() - j) return a.size() - i < b.size() - j;
    return a < b;
}

std::vector<size_t> evenly(size_t count, size_t most) {
    std::vector<size_t> indices;
    const size_t n = std::min(count, most);
    for (size_t i = 0; i < n; ++i) indices.push_back(i * count / n);
    return indices;
}

double selectedRate(double fps, std::span<const size_t> indices) {
    if (indices.size() < 2 || indices.back() <= indices.front()) return fps;
    return fps * double(indices.size() - 1) / double(indices.back() - indices.front());
}

std::vector<size_t> selectFrames(std::string_view text, size_t count, std::string_view what) {
    const auto wrong = [&] {
        throwInput(
            "{}: expected a:b, a:b:step, a frame's number, or a list of these with commas, "
            "found \"{}\"",
            what, text);
    };
    const auto total = static_cast<int64_t>(count);
    std::vector<bool> chosen(count, text.empty());
    size_t begin = 0;
    while (!text.empty() && begin <= text.size()) {
        const size_t comma = std::min(text.find(',', begin), text.size());
        std::string_view item = text.substr(begin, comma - begin);
        begin = comma + 1;
        // Up to three numbers between colons, each of which may be missing.
        std::vector<std::optional<int64_t>> numbers;
        while (true) {
            const size_t colon = std::min(item.find(':'), item.size());
            const std::string_view word = item.substr(0, colon);
            std::optional<int64_t> number;
            if (!word.empty()) {
                int64_t value = 0;
                const auto [end, error] =
                    std::from_chars(word.data(), word.data() + word.size(), value);
                if (error != std::errc() || end != word.data() + word.size()) wrong();
                number = value;
            }
            numbers.push_back(number);
            if (colon == item.size()) break;
            item.remove_prefix(colon + 1);
        }
        if (numbers.size() > 3 || (numbers.size() == 1 && !numbers[0])) wrong();
        const auto fromEnd = [&](int64_t i) { return i < 0 ? i + total : i; };
        if (numbers.size() == 1) {
            const int64_t i = fromEnd(*numbers[0]);
            if (i < 0 || i >= total) {
                throwInput("{}: expected a frame from 0 to {}, found {}", what, total - 1,
                           *numbers[0]);
            }
            chosen[size_t(i)] = true;
            continue;
        }
        const int64_t from = fromEnd(numbers[0].value_or(0));
        const int64_t to = fromEnd(numbers[1].value_or(total));
        const int64_t step = numbers.size() == 3 ? numbers[2].value_or(1) : 1;
        if (step < 1) throwInput("{}: expected a step of 1 or more, found {}", what, step);
        if (from < 0 || from > total || to < 0 || to > total) {
            throwInput("{}: expected frames within 0:{}, found \"{}\"", what, total, text);
        }
        for (int64_t i = from; i < to; i += step) chosen[size_t(i)] = true;
    }
    std::vector<size_t> indices;
    for (size_t i = 0; i < count; ++i) {
        if (chosen[i]) indices.push_back(i);
    }
    if (indices.empty()) {
        throwInput("{}: expected one frame or more of the {}, found none in \"{}\"", what, count,
                   text);
    }
    return indices;
}

bool isPictureName(const std::filesystem::path& path) {
    constexpr const char* kKnown[] = {".png",  ".jpg",  ".jpeg", ".heic", ".heif",
                                      ".avif", ".webp", ".tif",  ".tiff", ".bmp"};
    return std::ranges::count(kKnown, endingOf(path)) > 0;
}

std::vector<std::filesystem::path> picturesOfFolder(const std::filesystem::path& folder) {
    std::vector<std::filesystem::path> pictures;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
        if (!isPictureName(entry.path()) || entry.path().filename().string().starts_with('.'))
            continue;
        pictures.push_back(entry.path());
    }
    std::ranges::sort(pictures, [](const std::filesystem::path& a, const std::filesystem::path& b) {
        return naturallyBefore(a.filename().string(), b.filename().string());
    });
    return pictures;
}

}  // namespace doppel
