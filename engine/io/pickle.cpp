#include "engine/io/pickle.h"

#include <zlib.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <unordered_map>
#include <unordered_set>

#include "engine/atomic_file.h"
#include "engine/error.h"
#include "engine/printable.h"

namespace doppel {

using Kind = PickleValue::Kind;

namespace {

constexpr size_t kMaxNodes = 4'000'000;
constexpr uint64_t kMaxFile = uint64_t{2} << 30;
constexpr uint64_t kMaxElements = uint64_t{1} << 25;  // of lists and sparse matrices made arrays
constexpr int kMaxDepth = 32;                         // NumPy's limit of dimensions

// The names that a pickle may use, and what they mean here.
enum class Name : uint8_t {
    reconstruct,
    scalar,
    fromBuffer,
    ndarray,
    dtype,
    encode,
    reconstructor,
    baseObject,
    orderedDict,
    defaultDict,
    setType,
    bytesType,
    plainType,  // list, dict, int, …: only named, as a defaultdict's factory
    chumpy,
    chumpySelect,
    csc,
    csr,
    coo,
    joblibArray,
    torchStorage,
    torchTensor,
    torchParameter,
};

struct KnownName {
    const char* name;
    Name meaning;
};

constexpr KnownName kKnownNames[] = {
    {"numpy.core.multiarray._reconstruct", Name::reconstruct},
    {"numpy._core.multiarray._reconstruct", Name::reconstruct},
    {"numpy.core.multiarray.scalar", Name::scalar},
    {"numpy._core.multiarray.scalar", Name::scalar},
    {"numpy.core.numeric._frombuffer", Name::fromBuffer},
    {"numpy._core.numeric._frombuffer", Name::fromBuffer},
    {"numpy.ndarray", Name::ndarray},
    {"numpy.dtype", Name::dtype},
    {"_codecs.encode", Name::encode},
    {"copy_reg._reconstructor", Name::reconstructor},
    {"copyreg._reconstructor", Name::reconstructor},
    {"__builtin__.object", Name::baseObject},
    {"builtins.object", Name::baseObject},
    {"collections.OrderedDict", Name::orderedDict},
    {"collections.defaultdict", Name::defaultDict},
    {"__builtin__.set", Name::setType},
    {"builtins.set", Name::setType},
    {"__builtin__.frozenset", Name::setType},
    {"builtins.frozenset", Name::setType},
    {"__builtin__.bytes", Name::bytesType},
    {"builtins.bytes", Name::bytesType},
    {"__builtin__.bytearray", Name::bytesType},
    {"builtins.bytearray", Name::bytesType},
    {"__builtin__.list", Name::plainType},
    {"builtins.list", Name::plainType},
    {"__builtin__.dict", Name::plainType},
    {"builtins.dict", Name::plainType},
    {"__builtin__.int", Name::plainType},
    {"builtins.int", Name::plainType},
    {"__builtin__.float", Name::plainType},
    {"builtins.float", Name::plainType},
    {"chumpy.ch.Ch", Name::chumpy},
    {"chumpy.reordering.Select", Name::chumpySelect},
    {"scipy.sparse.csc.csc_matrix", Name::csc},
    {"scipy.sparse._csc.csc_matrix", Name::csc},
    {"scipy.sparse._csc.csc_array", Name::csc},
    {"scipy.sparse.csr.csr_matrix", Name::csr},
    {"scipy.sparse._csr.csr_matrix", Name::csr},
    {"scipy.sparse._csr.csr_array", Name::csr},
    {"scipy.sparse.coo.coo_matrix", Name::coo},
    {"scipy.sparse._coo.coo_matrix", Name::coo},
    {"scipy.sparse._coo.coo_array", Name::coo},
    {"joblib.numpy_pickle.NumpyArrayWrapper", Name::joblibArray},
};

// In PyTorch files only.
constexpr KnownName kTorchNames[] = {
    {"torch._utils._rebuild_tensor", Name::torchTensor},
    {"torch._utils._rebuild_tensor_v2", Name::torchTensor},
    {"torch._utils._rebuild_parameter", Name::torchParameter},
    {"torch.FloatStorage", Name::torchStorage},
    {"torch.DoubleStorage", Name::torchStorage},
    {"torch.HalfStorage", Name::torchStorage},
    {"torch.BFloat16Storage", Name::torchStorage},
    {"torch.LongStorage", Name::torchStorage},
    {"torch.IntStorage", Name::torchStorage},
    {"torch.ShortStorage", Name::torchStorage},
    {"torch.CharStorage", Name::torchStorage},
    {"torch.ByteStorage", Name::torchStorage},
    {"torch.BoolStorage", Name::torchStorage},
};

bool makesObjects(Name name) {
    return name == Name::chumpy || name == Name::chumpySelect || name == Name::csc ||
           name == Name::csr || name == Name::coo || name == Name::joblibArray;
}

// What an object-kind node is.
enum class Role : uint8_t { value, name, dtype, instance, emptyArray, torchStorage, torchTensor };

struct Node {
    Kind kind = Kind::none;
    Role role = Role::value;
    Name name{};  // role name and instance: which
    union {
        int64_t integer = 0;
        double real;
    };
    std::string text;  // text, bytes; dtype: NumPy's type string; an odd value's repr
    // list, tuple, set; dict: key, value, …; instance: its state; torchStorage: type, key, size;
    // torchTensor: storage, offset, shape, strides
    std::vector<uint32_t> items;
    std::unique_ptr<Array> array;
};

}  // namespace

struct PickleGraph {
    std::vector<Node> nodes;
};

namespace {

const char* kindName(const Node& node) {
    switch (node.kind) {
        case Kind::none:
            return "None";
        case Kind::boolean:
            return "a truth value";
        case Kind::integer:
            return "an integer";
        case Kind::real:
            return "a number";
        case Kind::text:
            return "text";
        case Kind::bytes:
            return "bytes";
        case Kind::list:
            return "a list";
        case Kind::tuple:
            return "a tuple";
        case Kind::set:
            return "a set";
        case Kind::dict:
            return "a dict";
        case Kind::array:
            return "an array";
        case Kind::object:
            return "an object";
    }
    return "something";
}

// ---- the machine --------------------------------------------------------------------------------

class Machine {
public:
    // torch: the pickle is part of a PyTorch file.
    Machine(std::span<const uint8_t> bytes, const std::string& name, PickleGraph& graph,
            bool torch = false)
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
        const auto pushKnown = [&](std::span<const KnownName> names) {
            for (const KnownName& known : names) {
                if (full != known.name) continue;
                const uint32_t node = add(Kind::object, Role::name);
                nodes_[node].name = known.meaning;
                nodes_[node].text = known.name;
                push(node);
                return true;
            }
            return false;
        };
        if (pushKnown(kKnownNames) || (torch_ && pushKnown(kTorchNames))) return;
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

std::vector<uint8_t> inflateAll(std::span<const uint8_t> packed, const std::string& name) {
    z_stream stream{};
    if (inflateInit(&stream) != Z_OK) throwMachine("zlib: no memory");
    struct Ender {
        z_stream* stream;
        ~Ender() { inflateEnd(stream); }
    } ender{&stream};
    std::vector<uint8_t> bytes, block(size_t{1} << 20);
    size_t consumed = 0;
    int status = Z_OK;
    while (status != Z_STREAM_END) {
        if (stream.avail_in == 0) {
            const size_t step = std::min(packed.size() - consumed, size_t{1} << 30);
            stream.next_in = const_cast<Bytef*>(packed.data() + consumed);
            stream.avail_in = static_cast<uInt>(step);
            consumed += step;
        }
        stream.next_out = block.data();
        stream.avail_out = static_cast<uInt>(block.size());
        status = inflate(&stream, Z_NO_FLUSH);
        if (status == Z_MEM_ERROR) throwMachine("zlib: no memory");
        if (status != Z_OK && status != Z_STREAM_END) {
            throwInput("{}: its packed bytes are damaged or cut short", name);
        }
        bytes.insert(bytes.end(), block.data(), stream.next_out);
        // Poses hardly shrink to a hundredth.
        if (bytes.size() > 100 * packed.size() + (size_t{1} << 26) || bytes.size() > kMaxFile) {
            throwInput("{}: unpacks from {} to more than {} bytes: refused as a zip bomb", name,
                       packed.size(), bytes.size());
        }
    }
    return bytes;
}

// ---- values -------------------------------------------------------------------------------------

[[noreturn]] void unexpected(const std::string& where, const char* expected, const Node& node) {
    throwInput("{}: expected {}, found {}", where, expected,
               node.text.empty() || node.kind != Kind::object ? kindName(node) : node.text);
}

// A dict's key, as text to compare with.
std::string keyText(const Node& node) {
    switch (node.kind) {
        case Kind::text:
        case Kind::bytes:
            return node.text;
        case Kind::integer:
            return std::to_string(node.integer);
        case Kind::boolean:
            return node.integer ? "True" : "False";
        case Kind::array:
            if (node.array->count() == 1 && node.array->isInteger()) {
                return std::to_string(node.array->integer());
            }
            return "an array";
        default:
            return kindName(node);
    }
}

const Node* findIn(const PickleGraph& graph, const Node& dict, std::string_view key) {
    // From the end: a later pair replaces an earlier one.
    for (size_t i = dict.items.size(); i >= 2; i -= 2) {
        if (keyText(graph.nodes[dict.items[i - 2]]) == key) return &graph.nodes[dict.items[i - 1]];
    }
    return nullptr;
}

// A list, or a list of lists …, of numbers as one array.
struct ListReader {
    const PickleGraph& graph;
    const std::string& where;
    std::vector<int64_t> shape;
    std::vector<double> values;
    std::vector<int64_t> integers;
    bool allIntegers = true;

    void read(const Node& node) {
        findShape(node);
        uint64_t count = 1;
        for (const int64_t size : shape) {
            if (__builtin_mul_overflow(count, static_cast<uint64_t>(size), &count) ||
                count > kMaxElements) {
                throwInput("{}: a list of more than {} numbers", where, kMaxElements);
            }
        }
        values.reserve(count);
        integers.reserve(count);
        fill(node, 0);
    }

private:
    // Along the first elements; fill() finds where others differ.
    void findShape(const Node& first) {
        const Node* node = &first;
        while (node->kind == Kind::list || node->kind == Kind::tuple) {
            if (shape.size() == kMaxDepth) {
                throwInput("{}: lists nested more than {} deep", where, kMaxDepth);
            }
            shape.push_back(static_cast<int64_t>(node->items.size()));
            if (node->items.empty()) return;
            node = &graph.nodes[node->items[0]];
        }
        if (node->kind == Kind::array) {
            shape.insert(shape.end(), node->array->shape.begin(), node->array->shape.end());
        }
    }

    void fill(const Node& node, size_t depth) {
        if (node.kind == Kind::list || node.kind == Kind::tuple) {
            if (depth >= shape.size() || static_cast<int64_t>(node.items.size()) != shape[depth]) {
                throwInput("{}: a list whose rows differ in length", where);
            }
            for (const uint32_t item : node.items) fill(graph.nodes[item], depth + 1);
        } else if (node.kind == Kind::array) {
            if (!std::equal(node.array->shape.begin(), node.array->shape.end(),
                            shape.begin() + static_cast<ptrdiff_t>(std::min(depth, shape.size())),
                            shape.end())) {
                throwInput("{}: a list of arrays whose shapes differ", where);
            }
            const std::vector<double> numbers = node.array->toF64(where);
            values.insert(values.end(), numbers.begin(), numbers.end());
            if (node.array->isFloat() || node.array->dtype == DType::u64) {
                allIntegers = false;
            } else if (allIntegers) {
                const std::vector<int64_t> whole = node.array->toI64(where);
                integers.insert(integers.end(), whole.begin(), whole.end());
            }
        } else {
            if (depth != shape.size()) throwInput("{}: a list whose rows differ in length", where);
            if (node.kind == Kind::integer || node.kind == Kind::boolean) {
                values.push_back(static_cast<double>(node.integer));
                integers.push_back(node.integer);
            } else if (node.kind == Kind::real) {
                values.push_back(node.real);
                allIntegers = false;
            } else {
                unexpected(where, "numbers in the list", node);
            }
        }
    }
};

Array toArray(const PickleGraph& graph, const Node& node, const std::string& where, int depth);

// The attribute of an object, as an array.
Array attributeArray(const PickleGraph& graph, const Node& node, const char* name,
                     const std::string& where, int depth) {
    const Node* value =
        node.items.empty() ? nullptr : findIn(graph, graph.nodes[node.items[0]], name);
    if (value == nullptr) {
        throwInput("{}: expected an attribute '{}' in the object, found none", where, name);
    }
    return toArray(graph, *value, fmt::format("{}.{}", where, name), depth);
}

Array sparseToDense(const PickleGraph& graph, const Node& node, const std::string& where,
                    int depth) {
    const Node& state = node.items.empty() ? node : graph.nodes[node.items[0]];
    const bool named = findIn(graph, state, "_shape") != nullptr;
    const std::vector<int64_t> shape =
        attributeArray(graph, node, named ? "_shape" : "shape", where, depth).toI64();
    if (shape.size() != 2 || shape[0] < 0 || shape[1] < 0 ||
        (shape[1] > 0 &&
         static_cast<uint64_t>(shape[0]) > kMaxElements / static_cast<uint64_t>(shape[1]))) {
        throwInput("{}: a sparse matrix of impossible shape", where);
    }
    const std::vector<double> data = attributeArray(graph, node, "data", where, depth).toF64();
    std::vector<double> dense(static_cast<size_t>(shape[0] * shape[1]));
    const auto put = [&](int64_t row, int64_t column, double value) {
        if (row < 0 || row >= shape[0] || column < 0 || column >= shape[1]) {
            throwInput("{}: a sparse matrix with an element at {}, {} outside its shape {} x {}",
                       where, row, column, shape[0], shape[1]);
        }
        dense[static_cast<size_t>(row * shape[1] + column)] += value;  // SciPy sums duplicates
    };
    if (node.name == Name::coo) {
        const std::vector<int64_t> rows = attributeArray(graph, node, "row", where, depth).toI64();
        const std::vector<int64_t> columns =
            attributeArray(graph, node, "col", where, depth).toI64();
        if (rows.size() != data.size() || columns.size() != data.size()) {
            throwInput("{}: a sparse matrix whose parts differ in length", where);
        }
        for (size_t i = 0; i < data.size(); ++i) put(rows[i], columns[i], data[i]);
    } else {
        const bool byColumn = node.name == Name::csc;
        const std::vector<int64_t> indices =
            attributeArray(graph, node, "indices", where, depth).toI64();
        const std::vector<int64_t> starts =
            attributeArray(graph, node, "indptr", where, depth).toI64();
        const int64_t lines = byColumn ? shape[1] : shape[0];
        const int64_t stored = static_cast<int64_t>(std::min(data.size(), indices.size()));
        if (starts.empty() || static_cast<int64_t>(starts.size() - 1) != lines) {
            throwInput("{}: a sparse matrix with {} starts for {} lines; expected one more", where,
                       starts.size(), lines);
        }
        for (int64_t line = 0; line < lines; ++line) {
            const int64_t begin = starts[static_cast<size_t>(line)];
            const int64_t end = starts[static_cast<size_t>(line) + 1];
            if (begin < 0 || end < begin || end > stored) {
                throwInput("{}: a sparse matrix with broken starts", where);
            }
            for (int64_t i = begin; i < end; ++i) {
                const int64_t index = indices[static_cast<size_t>(i)];
                put(byColumn ? index : line, byColumn ? line : index, data[static_cast<size_t>(i)]);
            }
        }
    }
    return Array::f64({shape[0], shape[1]}, dense);
}

// a.ravel()[idxs].reshape(preferred_shape)
Array selected(const PickleGraph& graph, const Node& node, const std::string& where, int depth) {
    const std::vector<double> source = attributeArray(graph, node, "a", where, depth).toF64();
    const Array indexArray = attributeArray(graph, node, "idxs", where, depth);
    const std::vector<int64_t> indices = indexArray.toI64();
    std::vector<double> values;
    values.reserve(indices.size());
    for (const int64_t index : indices) {
        if (index < 0 || index >= static_cast<int64_t>(source.size())) {
            throwInput("{}: selects element {} of {}", where, index, source.size());
        }
        values.push_back(source[static_cast<size_t>(index)]);
    }
    std::vector<int64_t> shape = {static_cast<int64_t>(values.size())};
    const Node& state = graph.nodes[node.items[0]];
    const Node* preferred = findIn(graph, state, "preferred_shape");
    if (preferred != nullptr && preferred->kind != Kind::none) {
        shape = toArray(graph, *preferred, where, depth).toI64();
    }
    uint64_t count = 1;
    for (const int64_t size : shape) {
        if (size < 0 || __builtin_mul_overflow(count, static_cast<uint64_t>(size), &count)) {
            throwInput("{}: an impossible shape", where);
        }
    }
    if (count != values.size()) {
        throwInput("{}: {} selected elements for {} places", where, values.size(), count);
    }
    return Array::f64(std::move(shape), values);
}

Array toArray(const PickleGraph& graph, const Node& node, const std::string& where, int depth) {
    if (depth > kMaxDepth) throwInput("{}: objects nested more than {} deep", where, kMaxDepth);
    Array array;
    switch (node.kind) {
        case Kind::array:
            array = *node.array;
            break;
        case Kind::boolean:
        case Kind::integer:
            array = Array::scalarI64(node.integer);
            break;
        case Kind::real:
            array = Array::scalarF64(node.real);
            break;
        case Kind::text:
        case Kind::bytes:
            array = Array::text(node.text);
            break;
        case Kind::list:
        case Kind::tuple: {
            ListReader reader{graph, where, {}, {}, {}};
            reader.read(node);
            array = reader.allIntegers && !reader.integers.empty()
                        ? Array::i64(std::move(reader.shape), reader.integers)
                        : Array::f64(std::move(reader.shape), reader.values);
            break;
        }
        case Kind::object:
            if (node.role != Role::instance) unexpected(where, "numbers", node);
            if (node.name == Name::chumpy) {
                array = attributeArray(graph, node, "x", where, depth + 1);
            } else if (node.name == Name::chumpySelect) {
                array = selected(graph, node, where, depth + 1);
            } else if (node.name == Name::joblibArray) {
                unexpected(where, "numbers", node);
            } else {
                array = sparseToDense(graph, node, where, depth + 1);
            }
            break;
        case Kind::none:
        case Kind::set:
        case Kind::dict:
            unexpected(where, "numbers", node);
    }
    array.where = where;
    return array;
}

}  // namespace

PickleValue::PickleValue(std::shared_ptr<const PickleGraph> graph, uint32_t node, std::string where)
    : graph_(std::move(graph)), node_(node), where_(std::move(where)) {}

Kind PickleValue::kind() const { return graph_->nodes[node_].kind; }

std::optional<PickleValue> PickleValue::find(std::string_view key) const {
    const Node& node = graph_->nodes[node_];
    if (node.kind != Kind::dict) unexpected(where_, "a dict", node);
    const Node* value = findIn(*graph_, node, key);
    if (value == nullptr) return std::nullopt;
    return PickleValue(graph_, static_cast<uint32_t>(value - graph_->nodes.data()),
                       fmt::format("{}: {}", where_, printable(key)));
}

PickleValue PickleValue::at(std::string_view key) const {
    if (std::optional<PickleValue> value = find(key)) return *value;
    std::string present;
    const std::vector<std::string> all = keys();
    for (size_t i = 0; i < all.size() && i < 20; ++i) {
        if (i > 0) present += ", ";
        present += printable(all[i], 40);
    }
    if (all.size() > 20) present += ", …";
    throwInput("{}: expected '{}' in the dict, found {}", where_, key,
               present.empty() ? "nothing" : present);
}

std::vector<std::string> PickleValue::keys() const {
    const Node& node = graph_->nodes[node_];
    if (node.kind != Kind::dict) unexpected(where_, "a dict", node);
    std::vector<std::string> keys;
    std::unordered_set<std::string> seen;
    for (size_t i = 0; i + 1 < node.items.size(); i += 2) {
        std::string key = keyText(graph_->nodes[node.items[i]]);
        if (seen.insert(key).second) keys.push_back(std::move(key));
    }
    return keys;
}

size_t PickleValue::size() const {
    const Node& node = graph_->nodes[node_];
    switch (node.kind) {
        case Kind::list:
        case Kind::tuple:
        case Kind::set:
            return node.items.size();
        case Kind::dict:
            return keys().size();
        default:
            unexpected(where_, "a list", node);
    }
}

PickleValue PickleValue::item(size_t index) const {
    const Node& node = graph_->nodes[node_];
    if (node.kind != Kind::list && node.kind != Kind::tuple && node.kind != Kind::set) {
        unexpected(where_, "a list", node);
    }
    if (index >= node.items.size()) {
        throwInput("{}: expected an element {}, found {} elements", where_, index,
                   node.items.size());
    }
    return PickleValue(graph_, node.items[index], fmt::format("{}[{}]", where_, index));
}

Array PickleValue::asArray() const { return toArray(*graph_, graph_->nodes[node_], where_, 0); }

double PickleValue::asNumber() const { return asArray().scalar(); }

int64_t PickleValue::asInteger() const { return asArray().integer(); }

std::string PickleValue::asText() const {
    const Node& node = graph_->nodes[node_];
    if (node.kind == Kind::text || node.kind == Kind::bytes) return node.text;
    if (node.kind == Kind::array) return node.array->toText(where_);
    unexpected(where_, "text", node);
}

std::optional<TorchTensor> PickleValue::asTorchTensor() const {
    const Node& node = graph_->nodes[node_];
    if (node.role != Role::torchTensor) return std::nullopt;
    const Node& storage = graph_->nodes[node.items[0]];
    const auto integers = [&](uint32_t index, const char* what) {
        const Node& list = graph_->nodes[index];
        std::vector<int64_t> values;
        if (list.kind != Kind::tuple && list.kind != Kind::list) {
            throwInput("{}: a tensor whose {} is {}", where_, what, kindName(list));
        }
        for (const uint32_t item : list.items) {
            const Node& value = graph_->nodes[item];
            if (value.kind != Kind::integer) {
                throwInput("{}: a tensor whose {} holds {}", where_, what, kindName(value));
            }
            values.push_back(value.integer);
        }
        return values;
    };
    const Node& offset = graph_->nodes[node.items[1]];
    if (offset.kind != Kind::integer) {
        throwInput("{}: a tensor whose offset is {}", where_, kindName(offset));
    }
    return TorchTensor{.storage = graph_->nodes[storage.items[1]].text,
                       .type = graph_->nodes[storage.items[0]].text.substr(6),  // "torch."
                       .storageSize = graph_->nodes[storage.items[2]].integer,
                       .offset = offset.integer,
                       .shape = integers(node.items[2], "shape"),
                       .strides = integers(node.items[3], "strides")};
}

PickleValue torchPickleFromBytes(std::span<const uint8_t> bytes, const std::string& name,
                                 size_t& consumed) {
    const auto graph = std::make_shared<PickleGraph>();
    Machine machine(bytes, name, *graph, true);
    const uint32_t root = machine.run();
    consumed = machine.consumed();
    return PickleValue(graph, root, name);
}

PickleValue pickleFromBytes(std::span<const uint8_t> bytes, const std::string& name) {
    const auto graph = std::make_shared<PickleGraph>();
    std::vector<uint8_t> inflated;
    // A zlib stream: no pickle starts with an 'x' opcode.
    if (bytes.size() >= 2 && bytes[0] == 0x78 && (bytes[0] * 256 + bytes[1]) % 31 == 0) {
        inflated = inflateAll(bytes, name);
        bytes = inflated;
    }
    const uint32_t root = Machine(bytes, name, *graph).run();
    return PickleValue(graph, root, name);
}

PickleValue readPickle(const std::filesystem::path& path) {
    return pickleFromBytes(readWholeFile(path, kMaxFile), path.string());
}

}  // namespace doppel
