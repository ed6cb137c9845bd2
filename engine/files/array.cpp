#include "engine/files/array.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <optional>
#include <type_traits>
#include <utility>

#include "engine/error.h"
#include "engine/files/numbers.h"
#include "engine/files/printable.h"

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

std::string rawTypeOf(const Array& array, std::vector<uint8_t>& widened) {
    CHECK(array.dtype != DType::other, "arrays of type other cannot be written");
    if (array.dtype != DType::text) {
        const DTypeInfo& type = info(array.dtype);
        CHECK(array.bytes.size() == static_cast<size_t>(array.count()) * type.size,
              "the bytes must fill the shape {}", array.shapeText());
        return fmt::format("{}{}{}", type.size == 1 ? '|' : '<', type.kind, type.size);
    }
    const size_t count = static_cast<size_t>(array.count());
    const size_t width = count == 0 ? 0 : array.bytes.size() / count;
    if (std::ranges::any_of(array.bytes, [](uint8_t byte) { return byte >= 128; })) {
        widened = array.bytes;
        return fmt::format("|S{}", width);
    }
    widened.assign(array.bytes.size() * 4, 0);  // as <U: what NumPy makes of a str
    for (size_t i = 0; i < array.bytes.size(); ++i) widened[i * 4] = array.bytes[i];
    return fmt::format("<U{}", width);
}

}  // namespace doppel
