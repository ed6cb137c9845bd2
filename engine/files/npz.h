// NumPy's .npy and .npz files: typed arrays by name.
//
//     Npz in = readNpz("poses.npz");
//     std::vector<float> betas = in.at("betas").requireShape({10}).toF32();
//     Npz out;
//     out.set("loss", Array::f32({3}, values));
//     writeNpz("loss.npz", out, true);
//
// Everything read is checked before it is believed: sizes against the file's, totals against
// limits, CRCs against the bytes. What is wrong with a file is an InputError that names file and
// array.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <span>
#include <string>
#include <string_view>
#include <utility>
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

// Arrays by name, in the order of the file or of set().
class Npz {
public:
    // InputError that lists what is there, where the name is missing.
    const Array& at(std::string_view name) const;
    const Array* find(std::string_view name) const;  // null where missing
    bool has(std::string_view name) const { return find(name) != nullptr; }
    void set(std::string name, Array array);  // replaces one of the same name
    size_t size() const { return arrays_.size(); }
    auto begin() const { return arrays_.begin(); }  // pairs of name and array
    auto end() const { return arrays_.end(); }

    std::string file;  // for errors; readNpz fills it in

private:
    std::vector<std::pair<std::string, Array>> arrays_;
};

// Sizes beyond these are refused before memory is taken.
struct NpzLimits {
    uint64_t maxFile = uint64_t{8} << 30;
    uint64_t maxTotal = uint64_t{8} << 30;  // bytes of all arrays together
    // What deflate may blow up more than 100 times: zeros do that honestly, and so does a zip bomb.
    uint64_t maxInflated = uint64_t{1} << 30;
    size_t maxArrays = 8192;
};

// Stored and deflated entries, zip64. Entries that are not called *.npy are left out, as NumPy
// does.
Npz readNpz(const std::filesystem::path& path, const NpzLimits& limits = {});
Npz npzFromBytes(std::span<const uint8_t> file, const std::string& name,
                 const NpzLimits& limits = {});
// The same bytes for the same arrays: no times are written. See AtomicFile for errors.
void writeNpz(const std::filesystem::path& path, const Npz& npz, bool compress);

Array readNpy(const std::filesystem::path& path, const NpzLimits& limits = {});
Array npyFromBytes(std::span<const uint8_t> file, const std::string& where);
void writeNpy(const std::filesystem::path& path, const Array& array);

// Raw elements of a NumPy type string ("<f4", ">i8", "|b1", "<U5", "|S3"), as .npy files and
// pickles hold them, into an Array: byte order, Fortran order and text are made ours. `data` has to
// have exactly the size that the type and the shape ask for.
Array arrayFromRaw(std::string_view descr, std::vector<int64_t> shape, bool fortranOrder,
                   std::span<const uint8_t> data, const std::string& where);

}  // namespace doppel
