#include "engine/files/npz.h"

#include <algorithm>
#include <bit>
#include <cctype>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>
#include <type_traits>
#include <unordered_set>

#include "engine/error.h"
#include "engine/files/atomic_file.h"
#include "engine/files/numbers.h"
#include "engine/files/printable.h"
#include "engine/files/zip.h"

static_assert(std::endian::native == std::endian::little, "arrays are kept little-endian");

namespace doppel {
namespace {

// ---- types ------------------------------------------------------------------------------------

struct DTypeInfo {
    DType dtype;
    char kind;  // NumPy's letter
    uint8_t size;
    const char* name;
};

constexpr DTypeInfo kDTypes[] = {
    {DType::boolean, 'b', 1, "bool"}, {DType::i8, 'i', 1, "int8"},
    {DType::u8, 'u', 1, "uint8"},     {DType::i16, 'i', 2, "int16"},
    {DType::u16, 'u', 2, "uint16"},   {DType::i32, 'i', 4, "int32"},
    {DType::u32, 'u', 4, "uint32"},   {DType::i64, 'i', 8, "int64"},
    {DType::u64, 'u', 8, "uint64"},   {DType::f16, 'f', 2, "float16"},
    {DType::f32, 'f', 4, "float32"},  {DType::f64, 'f', 8, "float64"},
    {DType::text, 'U', 0, "text"},    {DType::other, 'O', 0, "other"},
};

const DTypeInfo& info(DType dtype) { return kDTypes[static_cast<size_t>(dtype)]; }

// Product of the shape; nothing where a size is negative or the product leaves int64.
std::optional<int64_t> product(std::span<const int64_t> shape) {
    int64_t count = 1;
    bool empty = false;
    for (const int64_t size : shape) {
        if (size < 0) return std::nullopt;
        if (size == 0) empty = true;
        if (!empty && __builtin_mul_overflow(count, size, &count)) return std::nullopt;
    }
    return empty ? 0 : count;
}

template <typename T>
Array makeArray(DType dtype, std::vector<int64_t> shape, std::span<const T> values) {
    Array array;
    array.dtype = dtype;
    array.shape = std::move(shape);
    const std::optional<int64_t> count = product(array.shape);
    CHECK(count && static_cast<uint64_t>(*count) == values.size(),
          "{} values must fill the shape {}", values.size(), array.shapeText());
    array.bytes.resize(values.size_bytes());
    if (!values.empty()) std::memcpy(array.bytes.data(), values.data(), values.size_bytes());
    return array;
}

template <typename T>
T loadAt(const uint8_t* bytes, size_t index) {
    T value;
    std::memcpy(&value, bytes + index * sizeof(T), sizeof(T));
    return value;
}

// Calls visit(index, value) with every element in its own type.
template <typename Visit>
void visitNumbers(const Array& array, Visit visit) {
    const uint8_t* bytes = array.bytes.data();
    const size_t count = static_cast<size_t>(array.count());
    CHECK(array.bytes.size() == count * dtypeSize(array.dtype),
          "the bytes of {} must fill its shape {}", array.where, array.shapeText());
    const auto loop = [&]<typename T>(T) {
        for (size_t i = 0; i < count; ++i) visit(i, loadAt<T>(bytes, i));
    };
    switch (array.dtype) {
        case DType::boolean:
            for (size_t i = 0; i < count; ++i) visit(i, static_cast<uint8_t>(bytes[i] != 0));
            break;
        case DType::i8:
            loop(int8_t{});
            break;
        case DType::u8:
            loop(uint8_t{});
            break;
        case DType::i16:
            loop(int16_t{});
            break;
        case DType::u16:
            loop(uint16_t{});
            break;
        case DType::i32:
            loop(int32_t{});
            break;
        case DType::u32:
            loop(uint32_t{});
            break;
        case DType::i64:
            loop(int64_t{});
            break;
        case DType::u64:
            loop(uint64_t{});
            break;
        case DType::f16:
            for (size_t i = 0; i < count; ++i)
                visit(i, double(halfToFloat(loadAt<uint16_t>(bytes, i))));
            break;
        case DType::f32:
            loop(float{});
            break;
        case DType::f64:
            loop(double{});
            break;
        case DType::text:
        case DType::other:
            CHECK(false, "only numbers are visited");
            break;
    }
}

std::string_view nameOf(const Array& array, std::string_view what) {
    if (!what.empty()) return what;
    return array.where.empty() ? std::string_view("array") : std::string_view(array.where);
}

std::string typeText(const Array& array) {
    if (array.dtype != DType::other) return dtypeName(array.dtype);
    if (array.descr.find('O') != std::string::npos && array.descr.size() <= 2) {
        return "Python objects (" + array.descr + ")";
    }
    return "type " + array.descr.substr(0, 60);
}

template <typename T>
std::vector<T> toIntegers(const Array& array, std::string_view what, const char* expected) {
    if (!array.isInteger() && array.dtype != DType::boolean) {
        throwInput("{}: expected integers, found {}", nameOf(array, what), typeText(array));
    }
    std::vector<T> result(static_cast<size_t>(array.count()));
    visitNumbers(array, [&](size_t i, auto value) {
        if constexpr (std::is_integral_v<decltype(value)>) {
            if (!std::in_range<T>(value)) {
                throwInput("{}: expected {}, found {} at element {}", nameOf(array, what), expected,
                           value, i);
            }
            result[i] = static_cast<T>(value);
        }
    });
    return result;
}

void requireNumbers(const Array& array, std::string_view what) {
    if (!array.isNumber()) {
        throwInput("{}: expected numbers, found {}", nameOf(array, what), typeText(array));
    }
}

void requireOne(const Array& array, std::string_view what) {
    if (array.count() != 1) {
        throwInput("{}: expected one value, found shape {}", nameOf(array, what),
                   array.shapeText());
    }
}

std::string shapeToText(std::span<const int64_t> shape) {
    std::string text = "[";
    for (size_t i = 0; i < shape.size(); ++i) {
        if (i > 0) text += ", ";
        text += shape[i] == -1 ? std::string("any") : std::to_string(shape[i]);
    }
    return text + "]";
}

// ---- elements as NumPy lays them out ------------------------------------------------------------

// A type string taken apart: "<f4".
struct RawType {
    DType dtype = DType::other;
    char kind = 'O';
    bool swap = false;
    size_t itemSize = 0;  // bytes in the file; 0: not known (other)
};

RawType parseDescr(std::string_view descr) {
    RawType type;
    if (descr.size() < 2) return type;
    char order = '=';
    if (descr[0] == '<' || descr[0] == '>' || descr[0] == '|' || descr[0] == '=') {
        order = descr[0];
        descr.remove_prefix(1);
    }
    const char kind = descr[0];
    descr.remove_prefix(1);
    if (descr.empty() || descr.size() > 9) return type;
    size_t number = 0;
    for (const char c : descr) {
        if (c < '0' || c > '9') return type;
        number = number * 10 + static_cast<size_t>(c - '0');
    }
    if (kind == 'U' || kind == 'S') {
        type.dtype = DType::text;
        type.kind = kind;
        type.itemSize = kind == 'U' ? number * 4 : number;
        type.swap = kind == 'U' && order == '>';
        return type;
    }
    for (const DTypeInfo& each : kDTypes) {
        if (each.size != 0 && each.kind == kind && each.size == number) {
            type.dtype = each.dtype;
            type.kind = kind;
            type.itemSize = number;
            type.swap = order == '>' && number > 1;
        }
    }
    return type;
}

// Fortran order (first index fastest) to C order (last index fastest).
void fortranToC(std::span<const int64_t> shape, size_t itemSize, std::vector<uint8_t>& bytes) {
    if (shape.size() < 2 || bytes.empty()) return;
    std::vector<size_t> sizes(shape.begin(), shape.end());
    std::vector<size_t> strides(sizes.size());  // in elements, of the Fortran layout
    size_t stride = 1;
    for (size_t d = 0; d < sizes.size(); ++d) {
        strides[d] = stride;
        stride *= sizes[d];
    }
    std::vector<uint8_t> result(bytes.size());
    std::vector<size_t> index(sizes.size(), 0);
    size_t source = 0;
    for (size_t target = 0; target < stride; ++target) {
        std::memcpy(&result[target * itemSize], &bytes[source * itemSize], itemSize);
        for (size_t d = sizes.size(); d-- > 0;) {
            source += strides[d];
            if (++index[d] < sizes[d]) break;
            source -= strides[d] * sizes[d];
            index[d] = 0;
        }
    }
    bytes = std::move(result);
}

void swapElements(size_t itemSize, std::vector<uint8_t>& bytes) {
    for (size_t i = 0; i + itemSize <= bytes.size(); i += itemSize) {
        std::reverse(bytes.begin() + static_cast<ptrdiff_t>(i),
                     bytes.begin() + static_cast<ptrdiff_t>(i + itemSize));
    }
}

void appendUtf8(uint32_t code, std::string& out) {
    const auto put = [&](uint32_t byte) { out += static_cast<char>(byte); };
    if (code < 0x80) {
        put(code);
    } else if (code < 0x800) {
        put(0xC0 | (code >> 6));
        put(0x80 | (code & 63));
    } else if (code < 0x10000) {
        put(0xE0 | (code >> 12));
        put(0x80 | ((code >> 6) & 63));
        put(0x80 | (code & 63));
    } else {
        put(0xF0 | (code >> 18));
        put(0x80 | ((code >> 12) & 63));
        put(0x80 | ((code >> 6) & 63));
        put(0x80 | (code & 63));
    }
}

// UTF-32 (kind U) or bytes (kind S) to equally long UTF-8 elements.
void textToUtf8(char kind, size_t itemSize, size_t count, const std::string& where,
                std::vector<uint8_t>& bytes) {
    if (kind == 'S' || count == 0 || itemSize == 0) return;
    std::vector<std::string> texts(count);
    size_t width = 1;
    for (size_t i = 0; i < count; ++i) {
        for (size_t c = 0; c < itemSize / 4; ++c) {
            const uint32_t code = loadAt<uint32_t>(bytes.data() + i * itemSize, c);
            if (code == 0) break;
            if (code > 0x10FFFF) throwInput("{}: holds text that is not Unicode", where);
            appendUtf8(code, texts[i]);
        }
        width = std::max(width, texts[i].size());
    }
    bytes.assign(width * count, 0);
    for (size_t i = 0; i < count; ++i) {
        std::copy(texts[i].begin(), texts[i].end(), bytes.data() + i * width);
    }
}

// ---- .npy ---------------------------------------------------------------------------------------

struct NpyHeader {
    std::string descr;
    bool fortranOrder = false;
    std::vector<int64_t> shape;
    size_t dataOffset = 0;
};

// The header's dictionary: {'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }
class HeaderParser {
public:
    HeaderParser(std::string_view text, const std::string& where) : text_(text), where_(where) {}

    void parse(NpyHeader& header) {
        bool haveDescr = false, haveOrder = false, haveShape = false;
        expect('{');
        while (!accept('}')) {
            const std::string key = quoted();
            expect(':');
            if (key == "descr" && !haveDescr) {
                haveDescr = true;
                header.descr = peek() == '[' ? bracketed() : quoted();
            } else if (key == "fortran_order" && !haveOrder) {
                haveOrder = true;
                header.fortranOrder = boolean();
            } else if (key == "shape" && !haveShape) {
                haveShape = true;
                header.shape = tuple();
            } else {
                bad();
            }
            if (!accept(',') && peek() != '}') bad();
        }
        skipSpace();
        if (position_ != text_.size() || !haveDescr || !haveOrder || !haveShape) bad();
    }

private:
    [[noreturn]] void bad() const {
        throwInput("{}: the .npy header is not as NumPy writes it (near byte {})", where_,
                   position_);
    }
    void skipSpace() {
        while (position_ < text_.size() && (text_[position_] == ' ' || text_[position_] == '\n')) {
            ++position_;
        }
    }
    char peek() {
        skipSpace();
        return position_ < text_.size() ? text_[position_] : '\0';
    }
    bool accept(char c) {
        if (peek() != c) return false;
        ++position_;
        return true;
    }
    void expect(char c) {
        if (!accept(c)) bad();
    }
    std::string quoted() {
        const char quote = peek();
        if (quote != '\'' && quote != '"') bad();
        const size_t end = text_.find(quote, ++position_);
        if (end == std::string_view::npos) bad();
        std::string value(text_.substr(position_, end - position_));
        if (value.find('\\') != std::string::npos) bad();
        position_ = end + 1;
        return value;
    }
    // A structured type: kept as text only, to be named in an error.
    std::string bracketed() {
        const size_t begin = position_;
        int depth = 0;
        for (; position_ < text_.size(); ++position_) {
            const char c = text_[position_];
            if (c == '[') ++depth;
            if (c == ']' && --depth == 0) {
                ++position_;
                return std::string(text_.substr(begin, position_ - begin));
            }
        }
        bad();
    }
    bool boolean() {
        skipSpace();
        for (const auto& [word, value] : {std::pair{"True", true}, std::pair{"False", false}}) {
            if (text_.substr(position_).starts_with(word)) {
                position_ += std::strlen(word);
                return value;
            }
        }
        bad();
    }
    std::vector<int64_t> tuple() {
        std::vector<int64_t> sizes;
        expect('(');
        while (!accept(')')) {
            if (sizes.size() == 32) bad();  // NumPy's own limit
            const char first = peek();
            if (first < '0' || first > '9') bad();
            int64_t value = 0;
            while (position_ < text_.size() && text_[position_] >= '0' && text_[position_] <= '9') {
                if (value > (std::numeric_limits<int64_t>::max() - 9) / 10) bad();
                value = value * 10 + (text_[position_++] - '0');
            }
            if (position_ < text_.size() && text_[position_] == 'L')
                ++position_;  // Python 2's long
            sizes.push_back(value);
            if (!accept(',') && peek() != ')') bad();
        }
        return sizes;
    }

    std::string_view text_;
    const std::string& where_;
    size_t position_ = 0;
};

NpyHeader parseNpyHeader(std::span<const uint8_t> file, const std::string& where) {
    constexpr uint8_t kMagic[] = {0x93, 'N', 'U', 'M', 'P', 'Y'};
    if (file.size() < 10 || !std::equal(std::begin(kMagic), std::end(kMagic), file.begin())) {
        throwInput("{}: expected a NumPy array (.npy), found other content or {} bytes only", where,
                   file.size());
    }
    const int version = file[6];
    if (version < 1 || version > 3) {
        throwInput("{}: .npy version {}; expected 1, 2 or 3", where, version);
    }
    const size_t start = version == 1 ? 10 : 12;
    if (file.size() < start) throwInput("{}: cut short in the .npy header", where);
    const size_t length =
        version == 1 ? loadAt<uint16_t>(&file[8], 0) : loadAt<uint32_t>(&file[8], 0);
    if (length > file.size() - start) throwInput("{}: cut short in the .npy header", where);
    NpyHeader header;
    const std::string_view text(reinterpret_cast<const char*>(&file[0]) + start, length);
    HeaderParser(text, where).parse(header);
    header.dataOffset = start + length;
    return header;
}

// Header only; the elements follow as they are in Array::bytes. Text is widened to UTF-32 in
// `data`.
std::string makeNpyHeader(const Array& array, std::vector<uint8_t>& data) {
    CHECK(array.dtype != DType::other, "arrays of type other cannot be written");
    std::string descr;
    if (array.dtype == DType::text) {
        const size_t count = static_cast<size_t>(array.count());
        const size_t width = count == 0 ? 0 : array.bytes.size() / count;
        bool ascii = true;
        for (const uint8_t byte : array.bytes) ascii = ascii && byte < 128;
        if (ascii) {  // as <U: what NumPy makes of a str
            data.assign(array.bytes.size() * 4, 0);
            for (size_t i = 0; i < array.bytes.size(); ++i) data[i * 4] = array.bytes[i];
            descr = fmt::format("<U{}", width);
        } else {
            data = array.bytes;
            descr = fmt::format("|S{}", width);
        }
    } else {
        const DTypeInfo& type = info(array.dtype);
        CHECK(array.bytes.size() == static_cast<size_t>(array.count()) * type.size,
              "the bytes must fill the shape {}", array.shapeText());
        descr = fmt::format("{}{}{}", type.size == 1 ? '|' : '<', type.kind, type.size);
    }
    std::string shape = "(";
    for (size_t i = 0; i < array.shape.size(); ++i) {
        shape += fmt::format("{}{}", i > 0 ? ", " : "", array.shape[i]);
    }
    if (array.shape.size() == 1) shape += ",";
    shape += ")";
    std::string text =
        fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': {}, }}", descr, shape);
    // Data starts at a multiple of 64, as NumPy has it for memory maps.
    const size_t unpadded = 10 + text.size() + 1;
    text.append((64 - unpadded % 64) % 64, ' ');
    text += '\n';
    std::string header = "\x93NUMPY\x01";
    header += '\0';
    header += static_cast<char>(text.size() & 255);
    header += static_cast<char>(text.size() >> 8);
    return header + text;
}

}  // namespace

// ---- Array --------------------------------------------------------------------------------------

const char* dtypeName(DType dtype) { return info(dtype).name; }
size_t dtypeSize(DType dtype) { return info(dtype).size; }

Array Array::f32(std::vector<int64_t> shape, std::span<const float> values) {
    return makeArray(DType::f32, std::move(shape), values);
}
Array Array::f64(std::vector<int64_t> shape, std::span<const double> values) {
    return makeArray(DType::f64, std::move(shape), values);
}
Array Array::i32(std::vector<int64_t> shape, std::span<const int32_t> values) {
    return makeArray(DType::i32, std::move(shape), values);
}
Array Array::i64(std::vector<int64_t> shape, std::span<const int64_t> values) {
    return makeArray(DType::i64, std::move(shape), values);
}
Array Array::u8(std::vector<int64_t> shape, std::span<const uint8_t> values) {
    return makeArray(DType::u8, std::move(shape), values);
}
Array Array::scalarF32(float value) { return f32({}, std::span(&value, 1)); }
Array Array::scalarF64(double value) { return f64({}, std::span(&value, 1)); }
Array Array::scalarI64(int64_t value) { return i64({}, std::span(&value, 1)); }

Array Array::text(std::string_view value) {
    Array array;
    array.dtype = DType::text;
    array.bytes.assign(value.begin(), value.end());
    if (array.bytes.empty()) array.bytes.push_back(0);
    return array;
}

int64_t Array::count() const {
    const std::optional<int64_t> count = product(shape);
    CHECK(count.has_value(), "the shape {} of {} must be countable", shapeText(), where);
    return *count;
}

std::string Array::shapeText() const { return shapeToText(shape); }

std::vector<float> Array::toF32(std::string_view what) const {
    requireNumbers(*this, what);
    std::vector<float> result(static_cast<size_t>(count()));
    if (dtype == DType::f32) {
        CHECK(bytes.size() == result.size() * sizeof(float), "the bytes of {} must fill its shape",
              where);
        if (!bytes.empty()) std::memcpy(result.data(), bytes.data(), bytes.size());
        return result;
    }
    visitNumbers(*this, [&](size_t i, auto value) {
        if constexpr (std::is_same_v<decltype(value), double>) {
            if (std::isfinite(value) && std::abs(value) > std::numeric_limits<float>::max()) {
                throwInput("{}: {} at element {} is beyond the range of float32",
                           nameOf(*this, what), value, i);
            }
        }
        result[i] = static_cast<float>(value);
    });
    return result;
}

std::vector<double> Array::toF64(std::string_view what) const {
    requireNumbers(*this, what);
    std::vector<double> result(static_cast<size_t>(count()));
    visitNumbers(*this, [&](size_t i, auto value) { result[i] = static_cast<double>(value); });
    return result;
}

std::vector<int32_t> Array::toI32(std::string_view what) const {
    return toIntegers<int32_t>(*this, what, "32-bit integers");
}
std::vector<int64_t> Array::toI64(std::string_view what) const {
    return toIntegers<int64_t>(*this, what, "64-bit integers");
}
std::vector<uint8_t> Array::toU8(std::string_view what) const {
    return toIntegers<uint8_t>(*this, what, "integers from 0 to 255");
}

double Array::scalar(std::string_view what) const {
    requireNumbers(*this, what);
    requireOne(*this, what);
    return toF64(what).front();
}

int64_t Array::integer(std::string_view what) const {
    requireNumbers(*this, what);
    requireOne(*this, what);
    if (!isFloat()) return toI64(what).front();
    const double value = toF64(what).front();
    // 2^53: beyond it a double no longer tells neighbouring integers apart.
    if (!(std::abs(value) <= 9007199254740992.0) || value != std::floor(value)) {
        throwInput("{}: expected a whole number, found {}", nameOf(*this, what), value);
    }
    return static_cast<int64_t>(value);
}

std::string Array::toText(std::string_view what) const {
    if (dtype != DType::text) {
        throwInput("{}: expected text, found {}", nameOf(*this, what), typeText(*this));
    }
    requireOne(*this, what);
    const auto end = std::find(bytes.begin(), bytes.end(), uint8_t{0});
    return std::string(bytes.begin(), end);
}

const Array& Array::requireShape(std::initializer_list<int64_t> expected,
                                 std::string_view what) const {
    const bool fits =
        std::equal(shape.begin(), shape.end(), expected.begin(), expected.end(),
                   [](int64_t have, int64_t want) { return want < 0 || have == want; });
    if (!fits) {
        throwInput("{}: expected shape {}, found {}", nameOf(*this, what),
                   shapeToText(std::span(expected.begin(), expected.size())), shapeText());
    }
    return *this;
}

Array arrayFromRaw(std::string_view descr, std::vector<int64_t> shape, bool fortranOrder,
                   std::span<const uint8_t> data, const std::string& where) {
    Array array;
    array.where = where;
    array.shape = std::move(shape);
    const std::optional<int64_t> count = product(array.shape);
    if (!count) throwInput("{}: its shape {} is impossible", where, array.shapeText());
    const RawType type = parseDescr(descr);
    array.dtype = type.dtype;
    if (type.dtype == DType::text || type.dtype == DType::other) {
        array.descr = printable(descr);
    }
    if (type.dtype == DType::other) {
        if (array.descr == "|O" || array.descr == "O") array.bytes.assign(data.begin(), data.end());
        return array;
    }

    uint64_t expected = 0;
    if (__builtin_mul_overflow(static_cast<uint64_t>(*count), type.itemSize, &expected) ||
        expected != data.size()) {
        throwInput("{}: expected {} elements of {} bytes for shape {}, found {} bytes", where,
                   *count, type.itemSize, array.shapeText(), data.size());
    }
    // Only zero-width text has elements without bytes: they must not become memory.
    if (type.itemSize == 0 && *count > 65536) {
        throwInput("{}: {} empty texts; expected at most 65536", where, *count);
    }
    array.bytes.assign(data.begin(), data.end());
    if (type.swap) swapElements(type.dtype == DType::text ? 4 : type.itemSize, array.bytes);
    if (fortranOrder && type.itemSize > 0) fortranToC(array.shape, type.itemSize, array.bytes);
    if (type.dtype == DType::text) {
        textToUtf8(type.kind, type.itemSize, static_cast<size_t>(*count), where, array.bytes);
    }
    return array;
}

// ---- Npz ----------------------------------------------------------------------------------------

const Array* Npz::find(std::string_view name) const {
    for (const auto& [key, array] : arrays_) {
        if (key == name) return &array;
    }
    return nullptr;
}

const Array& Npz::at(std::string_view name) const {
    if (const Array* array = find(name)) return *array;
    std::string present;
    for (size_t i = 0; i < arrays_.size() && i < 20; ++i) {
        present += (i > 0 ? ", " : "") + arrays_[i].first;
    }
    if (arrays_.size() > 20) present += ", …";
    throwInput("{}: expected an array '{}', found {}", file.empty() ? "npz" : file, name,
               present.empty() ? "none" : present);
}

void Npz::set(std::string name, Array array) {
    for (auto& [key, old] : arrays_) {
        if (key == name) {
            old = std::move(array);
            return;
        }
    }
    arrays_.emplace_back(std::move(name), std::move(array));
}

Npz readNpz(const std::filesystem::path& path, const NpzLimits& limits) {
    return npzFromBytes(readWholeFile(path, limits.maxFile), path.string(), limits);
}

Npz npzFromBytes(std::span<const uint8_t> file, const std::string& name, const NpzLimits& limits) {
    Npz npz;
    npz.file = name;
    std::unordered_set<std::string> seen;
    const ZipLimits zipLimits{limits.maxTotal, limits.maxInflated, limits.maxArrays};
    for (const ZipEntry& entry : zipEntries(file, {}, name, zipLimits)) {
        if (!entry.name.ends_with(".npy")) continue;
        const std::string key =
            printable(std::string_view(entry.name).substr(0, entry.name.size() - 4));
        const std::string where = name + ": " + key;
        if (!seen.insert(key).second) throwInput("{}: stands twice in the file", where);
        npz.set(key, npyFromBytes(unpackZip(file, entry, where), where));
    }
    return npz;
}

void writeNpz(const std::filesystem::path& path, const Npz& npz, bool compress) {
    ZipWriter zip(path);
    for (const auto& [key, array] : npz) {
        CHECK(!key.empty(), "an array has a name");
        std::vector<uint8_t> widened;
        const std::string header = makeNpyHeader(array, widened);
        zip.add(key + ".npy",
                {std::span(reinterpret_cast<const uint8_t*>(header.data()), header.size()),
                 array.dtype == DType::text ? widened : array.bytes},
                compress);
    }
    zip.commit();
}

Array readNpy(const std::filesystem::path& path, const NpzLimits& limits) {
    return npyFromBytes(readWholeFile(path, std::min(limits.maxFile, limits.maxTotal)),
                        path.string());
}

Array npyFromBytes(std::span<const uint8_t> file, const std::string& where) {
    NpyHeader header = parseNpyHeader(file, where);
    return arrayFromRaw(header.descr, std::move(header.shape), header.fortranOrder,
                        file.subspan(header.dataOffset), where);
}

void writeNpy(const std::filesystem::path& path, const Array& array) {
    std::vector<uint8_t> widened;
    const std::string header = makeNpyHeader(array, widened);
    const std::vector<uint8_t>& data = array.dtype == DType::text ? widened : array.bytes;
    AtomicFile out(path);
    out.write(header);
    out.write(data.data(), data.size());
    out.commit();
}

}  // namespace doppel
