// What the opcodes of a pickle work on: the bytes in front of them, the values they made, those
// that wait on the stack, and those that were stored for later.
#pragma once

#include <algorithm>
#include <charconv>
#include <cstring>
#include <unordered_map>

#include "engine/error.h"
#include "engine/files/printable.h"
#include "engine/io/pickles/pickle_graph.h"

namespace doppel::pickle {

using Kind = PickleValue::Kind;

class Stack {
public:
    // torch: the pickle is part of a PyTorch file.
    Stack(std::span<const uint8_t> bytes, const std::string& name, PickleGraph& graph, bool torch)
        : bytes_(bytes),
          torch_(torch),
          file_(name),
          nodes_(graph.nodes),
          // What opcodes may copy: a few bytes of opcode can ask for a copy of a long text again
          // and again, so that a small file fills the memory.
          budget_((uint64_t{1} << 24) + 16 * bytes.size()) {}

protected:
    template <typename... Args>
    [[noreturn]] void bad(fmt::format_string<Args...> format, Args&&... args) const {
        throwInput("{}: not a pickle that can be read: {} (byte {})", file_,
                   fmt::format(format, std::forward<Args>(args)...), position_);
    }

    // ---- input
    std::span<const uint8_t> take(uint64_t size) {
        if (size > bytes_.size() - position_) {
            throwInput("{}: the pickle is cut short (expected {} more bytes, found {})", file_,
                       size, bytes_.size() - position_);
        }
        const auto result = bytes_.subspan(position_, static_cast<size_t>(size));
        position_ += static_cast<size_t>(size);
        return result;
    }

    template <typename T>
    T takeLittle() {
        T value;
        std::memcpy(&value, take(sizeof(T)).data(), sizeof(T));
        return value;
    }

    std::string_view takeText(uint64_t size) {
        const auto part = take(size);
        return {reinterpret_cast<const char*>(part.data()), part.size()};
    }

    std::string_view takeLine() {
        const auto rest = bytes_.subspan(position_);
        const auto end = std::find(rest.begin(), rest.end(), uint8_t{'\n'});
        if (end == rest.end()) throwInput("{}: the pickle is cut short", file_);
        std::string_view line = takeText(static_cast<uint64_t>(end - rest.begin()));
        ++position_;
        if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
        return line;
    }

    // ---- nodes and stack
    uint32_t add(Kind kind, Role role = Role::value) {
        if (nodes_.size() >= kMaxNodes) {
            throwInput("{}: holds more than {} values", file_, kMaxNodes);
        }
        nodes_.emplace_back();
        nodes_.back().kind = kind;
        nodes_.back().role = role;
        return static_cast<uint32_t>(nodes_.size() - 1);
    }

    void spend(uint64_t size) {
        if (size > budget_) throwInput("{}: unpacks to far more than its own size", file_);
        budget_ -= size;
    }

    void push(uint32_t node) {
        if (stack_.size() >= 4 * kMaxNodes) bad("too many values wait on its stack");
        stack_.push_back(node);
    }

    uint32_t pop() {
        if (stack_.size() <= (marks_.empty() ? 0 : marks_.back())) bad("a value is missing");
        const uint32_t node = stack_.back();
        stack_.pop_back();
        return node;
    }

    uint32_t top() {
        const uint32_t node = pop();
        push(node);
        return node;
    }

    std::vector<uint32_t> popToMark() {
        if (marks_.empty()) bad("a mark is missing");
        const auto begin = stack_.begin() + static_cast<ptrdiff_t>(marks_.back());
        std::vector<uint32_t> items(begin, stack_.end());
        stack_.erase(begin, stack_.end());
        marks_.pop_back();
        return items;
    }

    void pushText(Kind kind, std::string_view text) {
        spend(text.size());
        const uint32_t node = add(kind);
        nodes_[node].text = text;
        push(node);
    }

    void pushInteger(int64_t value, Kind kind = Kind::integer) {
        const uint32_t node = add(kind);
        nodes_[node].integer = value;
        push(node);
    }

    void pushReal(double value) {
        const uint32_t node = add(Kind::real);
        nodes_[node].real = value;
        push(node);
    }

    void pushItems(Kind kind, std::vector<uint32_t> items) {
        const uint32_t node = add(kind);
        nodes_[node].items = std::move(items);
        push(node);
    }

    void pushTuple(size_t size) {
        std::vector<uint32_t> items(size);
        for (size_t i = size; i-- > 0;) items[i] = pop();
        pushItems(Kind::tuple, std::move(items));
    }

    void remember(uint64_t key) {
        if (memo_.size() >= kMaxNodes) bad("it stores too many values");
        memo_[key] = top();
    }

    void recall(uint64_t key) {
        const auto it = memo_.find(key);
        if (it == memo_.end()) bad("it refers to a value {} that it never stored", key);
        push(it->second);
    }

    // ---- numbers and strings as text
    template <typename T>
    T number(std::string_view text) const {
        T value{};
        const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
        if (error != std::errc() || end != text.data() + text.size()) {
            bad("'{}' is not a number", printable(text));
        }
        return value;
    }

    // Two's complement, little-endian. What does not fit 64 bits is kept only as something odd.
    void pushLong(std::span<const uint8_t> digits);

    // Python's repr of a byte string: 'a\n\x00'.
    std::string unquote(std::string_view line) const;

    // Python's raw-unicode-escape: latin-1 with \uXXXX and \UXXXXXXXX.
    std::string rawUnicode(std::string_view line) const;

    // The bytes that Python gets by encoding this UTF-8 text as latin-1.
    std::string latin1(std::string_view text) const;

private:
    uint32_t hexCode(std::string_view digits) const;

protected:
    std::span<const uint8_t> bytes_;
    bool torch_;
    const std::string& file_;
    std::vector<Node>& nodes_;
    uint64_t budget_;
    size_t position_ = 0;
    std::vector<uint32_t> stack_;
    std::vector<size_t> marks_;
    std::unordered_map<uint64_t, uint32_t> memo_;
};

}  // namespace doppel::pickle
