#include "engine/io/pickle_machine.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "engine/error.h"
#include "engine/files/printable.h"

namespace doppel::pickle {

using Kind = PickleValue::Kind;

namespace {

class Machine {
public:
    // torch: the pickle is part of a PyTorch file.
    Machine(std::span<const uint8_t> bytes, const std::string& name, PickleGraph& graph, bool torch)
        : bytes_(bytes),
          torch_(torch),
          file_(name),
          nodes_(graph.nodes),
          // What opcodes may copy: a few bytes of opcode can ask for a copy of a long text again
          // and again, so that a small file fills the memory.
          budget_((uint64_t{1} << 24) + 16 * bytes.size()) {}

    size_t consumed() const { return position_; }

    uint32_t run() {
        while (true) {
            const uint8_t opcode = take(1)[0];
            if (opcode == '.') return pop();
            step(opcode);
        }
    }

private:
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
    void pushLong(std::span<const uint8_t> digits) {
        size_t size = digits.size();
        const uint8_t fill = size > 0 && (digits[size - 1] & 0x80) ? 0xFF : 0;
        while (size > 8 && digits[size - 1] == fill) --size;
        if (size > 8 || (size == 8 && digits.size() > 8 && (digits[7] & 0x80) != (fill & 0x80))) {
            const uint32_t node = add(Kind::object);
            nodes_[node].text = "an integer of more than 64 bits";
            push(node);
            return;
        }
        uint64_t value = fill ? ~uint64_t{0} : 0;
        for (size_t i = 0; i < size; ++i) {
            value &= ~(uint64_t{0xFF} << (8 * i));
            value |= uint64_t{digits[i]} << (8 * i);
        }
        pushInteger(static_cast<int64_t>(value));
    }

    static int hexDigit(char c) {
        if (c >= '0' && c <= '9') return c - '0';
        if (c >= 'a' && c <= 'f') return c - 'a' + 10;
        if (c >= 'A' && c <= 'F') return c - 'A' + 10;
        return -1;
    }

    uint32_t hexCode(std::string_view digits) const {
        uint32_t code = 0;
        for (const char c : digits) {
            if (hexDigit(c) < 0) bad("a broken escape in a text");
            code = code * 16 + static_cast<uint32_t>(hexDigit(c));
        }
        return code;
    }

    static void appendUtf8(uint32_t code, std::string& out) {
        const auto put = [&](uint32_t byte) { out += static_cast<char>(byte); };
        if (code < 0x80) {
            put(code);
        } else if (code < 0x800) {
            put(0xC0 | code >> 6);
            put(0x80 | (code & 63));
        } else {
            if (code < 0x10000) {
                put(0xE0 | code >> 12);
            } else {
                put(0xF0 | (code >> 18 & 7));
                put(0x80 | (code >> 12 & 63));
            }
            put(0x80 | (code >> 6 & 63));
            put(0x80 | (code & 63));
        }
    }

    // Python's repr of a byte string: 'a\n\x00'.
    std::string unquote(std::string_view line) const {
        if (line.size() < 2 || line.front() != line.back() ||
            (line.front() != '\'' && line.front() != '"')) {
            bad("a text without quotes");
        }
        line = line.substr(1, line.size() - 2);
        std::string result;
        for (size_t i = 0; i < line.size(); ++i) {
            if (line[i] != '\\') {
                result += line[i];
                continue;
            }
            if (++i >= line.size()) bad("a broken escape in a text");
            constexpr std::string_view kCodes = "\\\\''\"\"n\nr\rt\ta\ab\bf\fv\v";
            if (line[i] == 'x') {
                if (line.size() - i < 3) bad("a broken escape in a text");
                result += static_cast<char>(hexCode(line.substr(i + 1, 2)));
                i += 2;
            } else if (line[i] >= '0' && line[i] <= '7') {
                int code = 0;
                size_t digits = 0;
                while (digits < 3 && i + digits < line.size() && line[i + digits] >= '0' &&
                       line[i + digits] <= '7') {
                    code = code * 8 + (line[i + digits++] - '0');
                }
                result += static_cast<char>(code);
                i += digits - 1;
            } else {
                size_t at = 0;
                while (at < kCodes.size() && kCodes[at] != line[i]) at += 2;
                if (at >= kCodes.size()) bad("a broken escape in a text");
                result += kCodes[at + 1];
            }
        }
        return result;
    }

    // Python's raw-unicode-escape: latin-1 with \uXXXX and \UXXXXXXXX.
    std::string rawUnicode(std::string_view line) const {
        std::string result;
        for (size_t i = 0; i < line.size(); ++i) {
            const bool escape = line[i] == '\\' && i + 1 < line.size() &&
                                (line[i + 1] == 'u' || line[i + 1] == 'U');
            if (!escape) {
                appendUtf8(static_cast<unsigned char>(line[i]), result);
                continue;
            }
            const size_t digits = line[i + 1] == 'u' ? 4 : 8;
            if (line.size() - i < digits + 2) bad("a broken escape in a text");
            const uint32_t code = hexCode(line.substr(i + 2, digits));
            if (code > 0x10FFFF) bad("a broken escape in a text");
            appendUtf8(code, result);
            i += digits + 1;
        }
        return result;
    }

    // The bytes that Python gets by encoding this UTF-8 text as latin-1.
    std::string latin1(std::string_view text) const {
        std::string result;
        for (size_t i = 0; i < text.size(); ++i) {
            const unsigned char c = static_cast<unsigned char>(text[i]);
            if (c < 0x80) {
                result += text[i];
            } else if ((c == 0xC2 || c == 0xC3) && i + 1 < text.size() &&
                       (static_cast<unsigned char>(text[i + 1]) & 0xC0) == 0x80) {
                result += static_cast<char>((c & 3) << 6 |
                                            (static_cast<unsigned char>(text[++i]) & 0x3F));
            } else {
                bad("bytes kept as text hold a character beyond latin-1");
            }
        }
        return result;
    }

    // ---- names and calls
    void pushName(std::string_view module, std::string_view name) {
        const std::string full = fmt::format("{}.{}", module, name);
        if (const std::optional<Name> known = knownName(full, torch_)) {
            const uint32_t node = add(Kind::object, Role::name);
            nodes_[node].name = *known;
            nodes_[node].text = full;
            push(node);
            return;
        }
        throwInput("{}: refers to code ({}); only numeric data is read", file_, printable(full));
    }

    std::string_view textOf(uint32_t node) const {
        const Node& value = nodes_[node];
        if (value.kind != Kind::text && value.kind != Kind::bytes) {
            bad("expected text, found {}", kindName(value));
        }
        return value.text;
    }

    Name nameOf(uint32_t node) const {
        if (nodes_[node].role != Role::name) bad("it calls what is not a name");
        return nodes_[node].name;
    }

    uint32_t makeInstance(Name name) {
        const uint32_t node = add(Kind::object, Role::instance);
        nodes_[node].name = name;
        return node;
    }

    std::vector<int64_t> shapeOf(uint32_t node) const {
        const Node& value = nodes_[node];
        std::vector<int64_t> shape;
        const auto append = [&](const Node& size) {
            if (size.kind != Kind::integer || size.integer < 0) bad("a shape is not made of sizes");
            shape.push_back(size.integer);
        };
        if (value.kind == Kind::integer) {
            append(value);
        } else if (value.kind == Kind::tuple || value.kind == Kind::list) {
            if (value.items.size() > kMaxDepth) bad("an array of too many dimensions");
            for (const uint32_t item : value.items) append(nodes_[item]);
        } else {
            bad("a shape is {}", kindName(value));
        }
        return shape;
    }

    bool truthOf(uint32_t node) const {
        const Node& value = nodes_[node];
        if (value.kind != Kind::boolean && value.kind != Kind::integer) {
            bad("expected true or false, found {}", kindName(value));
        }
        return value.integer != 0;
    }

    void fillArray(uint32_t node, uint32_t dtype, std::vector<int64_t> shape, bool fortran,
                   std::span<const uint8_t> data) {
        if (nodes_[dtype].role != Role::dtype) bad("an array without a type");
        spend(data.size());
        Array array = arrayFromRaw(nodes_[dtype].text, std::move(shape), fortran, data, file_);
        Node& target = nodes_[node];
        target.kind = Kind::array;
        target.role = Role::value;
        target.array = std::make_unique<Array>(std::move(array));
    }

    static std::span<const uint8_t> asBytes(std::string_view text) {
        return {reinterpret_cast<const uint8_t*>(text.data()), text.size()};
    }

    // function(*arguments), for the few functions that make data.
    uint32_t call(Name function, const std::vector<uint32_t>& arguments) {
        const size_t count = arguments.size();
        const auto need = [&](size_t least) {
            if (count < least) bad("a call with {} arguments; expected {}", count, least);
        };
        switch (function) {
            case Name::reconstruct:
                need(1);
                if (nameOf(arguments[0]) != Name::ndarray) bad("it rebuilds what is no array");
                return add(Kind::object, Role::emptyArray);
            case Name::scalar: {
                need(2);
                const uint32_t node = add(Kind::array);
                fillArray(node, arguments[0], {}, false, asBytes(textOf(arguments[1])));
                return node;
            }
            case Name::fromBuffer: {
                need(4);
                const uint32_t node = add(Kind::array);
                fillArray(node, arguments[1], shapeOf(arguments[2]), textOf(arguments[3]) == "F",
                          asBytes(textOf(arguments[0])));
                return node;
            }
            case Name::dtype: {
                need(1);
                const std::string_view text = textOf(arguments[0]);
                spend(text.size());
                const uint32_t node = add(Kind::object, Role::dtype);
                nodes_[node].text = textOf(arguments[0]);
                return node;
            }
            case Name::encode: {
                need(2);
                const std::string_view encoding = textOf(arguments[1]);
                if (encoding != "latin1" && encoding != "latin-1") {
                    bad("text encoded as {}; expected latin1", printable(encoding));
                }
                spend(textOf(arguments[0]).size());
                std::string encoded = latin1(textOf(arguments[0]));
                const uint32_t node = add(Kind::bytes);
                nodes_[node].text = std::move(encoded);
                return node;
            }
            case Name::reconstructor:
                need(1);
                if (!makesObjects(nameOf(arguments[0]))) bad("it rebuilds what is no object");
                return makeInstance(nameOf(arguments[0]));
            case Name::orderedDict: {
                std::vector<uint32_t> pairs;
                if (count > 0) {
                    for (const uint32_t pair : nodes_[arguments[0]].items) {
                        const Node& node = nodes_[pair];
                        const bool sequence = node.kind == Kind::list || node.kind == Kind::tuple;
                        if (!sequence || node.items.size() != 2) bad("a dict is not made of pairs");
                        pairs.insert(pairs.end(), node.items.begin(), node.items.end());
                    }
                }
                spend(pairs.size() * sizeof(uint32_t));
                const uint32_t node = add(Kind::dict);
                nodes_[node].items = std::move(pairs);
                return node;
            }
            case Name::defaultDict:
                return add(Kind::dict);
            case Name::setType: {
                std::vector<uint32_t> items;
                if (count > 0) {
                    const Node& source = nodes_[arguments[0]];
                    if (source.kind != Kind::list && source.kind != Kind::tuple) {
                        bad("a set is made of {}", kindName(source));
                    }
                    spend(source.items.size() * sizeof(uint32_t));
                    items = source.items;
                }
                const uint32_t node = add(Kind::set);
                nodes_[node].items = std::move(items);
                return node;
            }
            case Name::bytesType: {
                std::string value;
                if (count > 0) {
                    spend(textOf(arguments[0]).size());
                    value = nodes_[arguments[0]].kind == Kind::text ? latin1(textOf(arguments[0]))
                                                                    : nodes_[arguments[0]].text;
                }
                const uint32_t node = add(Kind::bytes);
                nodes_[node].text = std::move(value);
                return node;
            }
            case Name::chumpy:
            case Name::chumpySelect:
            case Name::csc:
            case Name::csr:
            case Name::coo:
            case Name::joblibArray:
                if (count > 0) bad("an object made from arguments");
                return makeInstance(function);
            case Name::torchTensor: {
                // (storage, offset, shape, strides, …)
                need(4);
                if (nodes_[arguments[0]].role != Role::torchStorage)
                    bad("a tensor without storage");
                const uint32_t node = add(Kind::object, Role::torchTensor);
                nodes_[node].text = "a PyTorch tensor";
                nodes_[node].items.assign(arguments.begin(), arguments.begin() + 4);
                return node;
            }
            case Name::torchParameter:
                need(1);
                return arguments[0];
            case Name::ndarray:
            case Name::baseObject:
            case Name::plainType:
            case Name::torchStorage:
                break;
        }
        bad("it calls a type that holds no data");
    }

    std::vector<uint32_t> argumentsOf(uint32_t node) const {
        if (nodes_[node].kind != Kind::tuple) bad("arguments that are no tuple");
        return nodes_[node].items;
    }

    // Gives the value below its state.
    void build(uint32_t node, uint32_t state) {
        const Node& value = nodes_[state];
        switch (nodes_[node].role) {
            case Role::dtype: {
                // (version, byte order, subtype, names, fields, item size, …)
                if (value.kind != Kind::tuple || value.items.size() < 5)
                    bad("a type without state");
                const std::string_view order = textOf(value.items[1]);
                if (nodes_[value.items[2]].kind != Kind::none ||
                    nodes_[value.items[3]].kind != Kind::none) {
                    nodes_[node].text = "structured";
                    return;
                }
                if (order.size() != 1) bad("a byte order of more than a letter");
                std::string& text = nodes_[node].text;
                if (!text.empty() && std::strchr("<>|=", text[0]) != nullptr) text.erase(0, 1);
                text.insert(0, 1, order[0]);
                return;
            }
            case Role::emptyArray: {
                // (version, shape, type, Fortran order, bytes); the first releases had no version.
                if (value.kind != Kind::tuple || value.items.size() < 4 || value.items.size() > 5) {
                    bad("an array without state");
                }
                const size_t first = value.items.size() - 4;
                const uint32_t dtype = value.items[first + 1], data = value.items[first + 3];
                std::vector<int64_t> shape = shapeOf(value.items[first]);
                const bool fortran = truthOf(value.items[first + 2]);
                if (nodes_[data].kind == Kind::list) {  // an array of Python objects
                    spend(nodes_[data].items.size() * sizeof(uint32_t));
                    nodes_[node].items = std::vector<uint32_t>(nodes_[data].items);
                    nodes_[node].kind = Kind::list;
                    nodes_[node].role = Role::value;
                    return;
                }
                fillArray(node, dtype, std::move(shape), fortran, asBytes(textOf(data)));
                return;
            }
            case Role::instance: {
                uint32_t dict = state;
                if (value.kind == Kind::tuple && value.items.size() == 2) dict = value.items[0];
                if (nodes_[dict].kind != Kind::dict) bad("an object whose state is no dict");
                nodes_[node].items = {dict};
                if (nodes_[node].name == Name::joblibArray) readJoblibArray(node, dict);
                return;
            }
            case Role::value:
                // OrderedDict and the like may carry attributes of their own: they are no data.
                if (nodes_[node].kind == Kind::dict || nodes_[node].kind == Kind::set) return;
                break;
            case Role::torchTensor:
                return;  // attributes of its own: no data
            case Role::name:
            case Role::torchStorage:
                break;
        }
        bad("a state for what takes none");
    }

    // ("storage", type, key, device, elements, …)
    uint32_t torchStorage(uint32_t id) {
        const std::vector<uint32_t> parts = argumentsOf(id);
        if (parts.size() < 5 || textOf(parts[0]) != "storage") bad("a reference to no storage");
        if (nodes_[parts[1]].role != Role::name || nodes_[parts[1]].name != Name::torchStorage) {
            bad("a storage of no type");
        }
        textOf(parts[2]);
        if (nodes_[parts[4]].kind != Kind::integer) bad("a storage of no size");
        if (parts.size() > 5 && nodes_[parts[5]].kind != Kind::none) bad("a view of a storage");
        const uint32_t node = add(Kind::object, Role::torchStorage);
        nodes_[node].text = "a PyTorch storage";
        nodes_[node].items = {parts[1], parts[2], parts[4]};
        return node;
    }

    const Node* attribute(uint32_t dict, std::string_view name) const {
        const std::vector<uint32_t>& items = nodes_[dict].items;
        for (size_t i = 0; i + 1 < items.size(); i += 2) {
            if (nodes_[items[i]].text == name) return &nodes_[items[i + 1]];
        }
        return nullptr;
    }

    // joblib puts an array's bytes right behind the object that describes it.
    void readJoblibArray(uint32_t node, uint32_t dict) {
        const Node* shape = attribute(dict, "shape");
        const Node* dtype = attribute(dict, "dtype");
        const Node* order = attribute(dict, "order");
        const Node* alignment = attribute(dict, "numpy_array_alignment_bytes");
        if (shape == nullptr || dtype == nullptr || dtype->role != Role::dtype) {
            bad("an array without shape or type");
        }
        if (alignment != nullptr && alignment->kind == Kind::integer) take(take(1)[0]);
        std::vector<int64_t> sizes = shapeOf(static_cast<uint32_t>(shape - nodes_.data()));
        // "<f8": the size of an element ends the type string.
        const std::string type = dtype->text;
        const size_t digits = type.find_first_of("0123456789");
        if (digits == std::string::npos || type.find_first_of("OSUV") != std::string::npos) {
            bad("an array of type {}", printable(type));
        }
        uint64_t bytes = number<uint32_t>(std::string_view(type).substr(digits));
        for (const int64_t size : sizes) {
            if (__builtin_mul_overflow(bytes, static_cast<uint64_t>(size), &bytes)) {
                bad("an array of impossible size");
            }
        }
        const bool fortran = order != nullptr && order->text == "F";
        fillArray(node, static_cast<uint32_t>(dtype - nodes_.data()), std::move(sizes), fortran,
                  take(bytes));
    }

    // ---- one opcode
    void step(uint8_t opcode) {
        switch (opcode) {
            case 0x80: {  // PROTO
                const uint8_t protocol = take(1)[0];
                if (protocol > 5) bad("protocol {}; expected 0 to 5", protocol);
                return;
            }
            case 0x95: {  // FRAME
                if (takeLittle<uint64_t>() > bytes_.size() - position_) {
                    throwInput("{}: the pickle is cut short", file_);
                }
                return;
            }
            case '(':
                marks_.push_back(stack_.size());
                return;
            case '0':  // POP, of a mark as well
                if (!marks_.empty() && marks_.back() == stack_.size()) {
                    marks_.pop_back();
                } else {
                    pop();
                }
                return;
            case '1':
                popToMark();
                return;
            case '2':
                push(top());
                return;

            case 'N':
                push(add(Kind::none));
                return;
            case 0x88:
                pushInteger(1, Kind::boolean);
                return;
            case 0x89:
                pushInteger(0, Kind::boolean);
                return;
            case 'I': {
                const std::string_view line = takeLine();
                if (line == "00" || line == "01") {
                    pushInteger(line == "01", Kind::boolean);
                } else {
                    pushInteger(number<int64_t>(line));
                }
                return;
            }
            case 'L': {
                std::string_view line = takeLine();
                if (!line.empty() && line.back() == 'L') line.remove_suffix(1);
                pushInteger(number<int64_t>(line));
                return;
            }
            case 'J':
                pushInteger(takeLittle<int32_t>());
                return;
            case 'K':
                pushInteger(take(1)[0]);
                return;
            case 'M':
                pushInteger(takeLittle<uint16_t>());
                return;
            case 0x8a:
                pushLong(take(take(1)[0]));
                return;
            case 0x8b:
                pushLong(take(takeLittle<uint32_t>()));
                return;
            case 'F':
                pushReal(number<double>(takeLine()));
                return;
            case 'G': {
                uint64_t bits = 0;
                for (const uint8_t byte : take(8)) bits = bits << 8 | byte;
                double value;
                std::memcpy(&value, &bits, sizeof value);
                pushReal(value);
                return;
            }

            case 'S':
                pushText(Kind::bytes, unquote(takeLine()));
                return;
            case 'T':
                pushText(Kind::bytes, takeText(takeLittle<uint32_t>()));
                return;
            case 'U':
                pushText(Kind::bytes, takeText(take(1)[0]));
                return;
            case 'B':
                pushText(Kind::bytes, takeText(takeLittle<uint32_t>()));
                return;
            case 'C':
                pushText(Kind::bytes, takeText(take(1)[0]));
                return;
            case 0x8e:
                pushText(Kind::bytes, takeText(takeLittle<uint64_t>()));
                return;
            case 0x96:
                pushText(Kind::bytes, takeText(takeLittle<uint64_t>()));
                return;
            case 'V':
                pushText(Kind::text, rawUnicode(takeLine()));
                return;
            case 'X':
                pushText(Kind::text, takeText(takeLittle<uint32_t>()));
                return;
            case 0x8c:
                pushText(Kind::text, takeText(take(1)[0]));
                return;
            case 0x8d:
                pushText(Kind::text, takeText(takeLittle<uint64_t>()));
                return;

            case ')':
                push(add(Kind::tuple));
                return;
            case ']':
                push(add(Kind::list));
                return;
            case '}':
                push(add(Kind::dict));
                return;
            case 0x8f:
                push(add(Kind::set));
                return;
            case 't':
                pushItems(Kind::tuple, popToMark());
                return;
            case 'l':
                pushItems(Kind::list, popToMark());
                return;
            case 0x91:
                pushItems(Kind::set, popToMark());
                return;
            case 'd': {
                std::vector<uint32_t> items = popToMark();
                if (items.size() % 2 != 0) bad("a dict with half a pair");
                pushItems(Kind::dict, std::move(items));
                return;
            }
            case 0x85:
                pushTuple(1);
                return;
            case 0x86:
                pushTuple(2);
                return;
            case 0x87:
                pushTuple(3);
                return;
            case 'a': {
                const uint32_t item = pop();
                extend(Kind::list, {item});
                return;
            }
            case 'e': {
                std::vector<uint32_t> items = popToMark();
                extend(Kind::list, items);
                return;
            }
            case 0x90: {
                std::vector<uint32_t> items = popToMark();
                extend(Kind::set, items);
                return;
            }
            case 's': {
                const uint32_t value = pop(), key = pop();
                extend(Kind::dict, {key, value});
                return;
            }
            case 'u': {
                std::vector<uint32_t> items = popToMark();
                if (items.size() % 2 != 0) bad("a dict with half a pair");
                extend(Kind::dict, items);
                return;
            }

            case 'p':
                remember(number<uint32_t>(takeLine()));
                return;
            case 'q':
                remember(take(1)[0]);
                return;
            case 'r':
                remember(takeLittle<uint32_t>());
                return;
            case 0x94:
                remember(memo_.size());
                return;
            case 'g':
                recall(number<uint32_t>(takeLine()));
                return;
            case 'h':
                recall(take(1)[0]);
                return;
            case 'j':
                recall(takeLittle<uint32_t>());
                return;

            case 'c': {
                const std::string_view module = takeLine();
                pushName(module, takeLine());
                return;
            }
            case 0x93: {
                const uint32_t name = pop(), module = pop();
                pushName(textOf(module), textOf(name));
                return;
            }
            case 'R': {
                const uint32_t arguments = pop(), function = pop();
                push(call(nameOf(function), argumentsOf(arguments)));
                return;
            }
            case 0x92:
                pop();
                [[fallthrough]];  // NEWOBJ_EX: keyword arguments on top
            case 0x81: {
                const uint32_t arguments = pop(), type = pop();
                push(call(nameOf(type), argumentsOf(arguments)));
                return;
            }
            case 'i': {
                const std::string_view module = takeLine();
                const std::string_view name = takeLine();
                const std::vector<uint32_t> arguments = popToMark();
                pushName(module, name);
                push(call(nameOf(pop()), arguments));
                return;
            }
            case 'o': {
                std::vector<uint32_t> arguments = popToMark();
                if (arguments.empty()) bad("an object without a type");
                const uint32_t type = arguments.front();
                arguments.erase(arguments.begin());
                push(call(nameOf(type), arguments));
                return;
            }
            case 'b': {
                const uint32_t state = pop();
                build(top(), state);
                return;
            }
            case 'Q':
                if (torch_) {
                    push(torchStorage(pop()));
                    return;
                }
                [[fallthrough]];
            case 'P':
                throwInput("{}: refers to data outside the file (a persistent id)", file_);
            case 0x82:
            case 0x83:
            case 0x84:
                throwInput(
                    "{}: refers to code (by an extension's number); only numeric data is read",
                    file_);
            case 0x97:
            case 0x98:
                throwInput("{}: refers to buffers outside the file", file_);
            default:
                --position_;
                bad("the opcode 0x{:02x} is unknown", opcode);
        }
    }

    void extend(Kind kind, const std::vector<uint32_t>& items) {
        Node& target = nodes_[top()];
        if (target.kind != kind) bad("it adds to {}", kindName(target));
        target.items.insert(target.items.end(), items.begin(), items.end());
    }

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

}  // namespace

uint32_t run(std::span<const uint8_t> bytes, const std::string& name, PickleGraph& graph,
             bool torch, size_t& consumed) {
    Machine machine(bytes, name, graph, torch);
    const uint32_t root = machine.run();
    consumed = machine.consumed();
    return root;
}

}  // namespace doppel::pickle
