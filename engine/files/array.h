// Typed arrays, with their elements as NumPy lays them out.
#pragma once

#include <cstdint>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace doppel {

enum class DType : uint8_t {
    boolean,  // one byte, 0 or 1
    i8,
    u8,
    i16,
    u16,
    i32,
    u32,
    i64,
    u64,
    f16,
    f32,
    f64,
    text,   // UTF-8, every element padded with NULs to the same number of bytes
    other,  // cannot be read here, but the file's other arrays can: see Array::descr. The bytes of
            // Python objects ("|O") are a pickle, for engine/io/pickle.h; others have no bytes
};

const char* dtypeName(DType dtype);  // "float32", as NumPy says it
size_t dtypeSize(DType dtype);       // bytes per element; 0 for text and other

// Elements in C order, in this machine's byte order. Empty shape: one element (a 0-d array).
struct Array {
    DType dtype = DType::f32;
    std::vector<int64_t> shape;
    std::vector<uint8_t> bytes;
    std::string where;  // "poses.npz: betas", for errors; readers fill it in
    std::string descr;  // of text and other: the type as the file says it, "|O"

    static Array f32(std::vector<int64_t> shape, std::span<const float> values);
    static Array f64(std::vector<int64_t> shape, std::span<const double> values);
    static Array i32(std::vector<int64_t> shape, std::span<const int32_t> values);
    static Array i64(std::vector<int64_t> shape, std::span<const int64_t> values);
    static Array u8(std::vector<int64_t> shape, std::span<const uint8_t> values);
    static Array scalarF32(float value);        // 0-d
    static Array scalarF64(double value);       // 0-d
    static Array scalarI64(int64_t value);      // 0-d
    static Array text(std::string_view value);  // 0-d

    int64_t count() const;  // elements
    bool isInteger() const { return dtype >= DType::i8 && dtype <= DType::u64; }
    bool isFloat() const { return dtype >= DType::f16 && dtype <= DType::f64; }
    bool isNumber() const { return dtype <= DType::f64; }  // booleans are numbers, as in NumPy
    std::string shapeText() const;                         // "[24, 3]"

    // Copies with conversion. `what` names the array in errors; left empty, it is `where`.
    // toF32, toF64: from any number; a finite value beyond the range of float is an InputError.
    // toI32, toI64, toU8: from integers and booleans; a value out of range is an InputError.
    std::vector<float> toF32(std::string_view what = {}) const;
    std::vector<double> toF64(std::string_view what = {}) const;
    std::vector<int32_t> toI32(std::string_view what = {}) const;
    std::vector<int64_t> toI64(std::string_view what = {}) const;
    std::vector<uint8_t> toU8(std::string_view what = {}) const;

    // The only element of an array of any shape. integer() also takes a whole number stored as
    // float.
    double scalar(std::string_view what = {}) const;
    int64_t integer(std::string_view what = {}) const;
    std::string toText(std::string_view what = {}) const;

    // InputError unless the shape is this one (−1: any size). Returns the array itself.
    const Array& requireShape(std::initializer_list<int64_t> expected,
                              std::string_view what = {}) const;
};

// Raw elements of a NumPy type string ("<f4", ">i8", "|b1", "<U5", "|S3"), as .npy files and
// pickles hold them, into an Array: byte order, Fortran order and text are made ours. `data` has to
// have exactly the size that the type and the shape ask for.
Array arrayFromRaw(std::string_view descr, std::vector<int64_t> shape, bool fortranOrder,
                   std::span<const uint8_t> data, const std::string& where);

// The type string of an array and its elements as NumPy stores them. An array of text has other
// bytes there than here, and they go into `widened`; not for arrays of type other.
std::string rawTypeOf(const Array& array, std::vector<uint8_t>& widened);

}  // namespace doppel
