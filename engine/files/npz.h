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

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/files/array.h"

namespace doppel {

// Arrays by name, in the order of the file or of set().
class Npz {
public:
    // InputError that lists what is there, where the name is missing.
    const Array& at(std::string_view name) const;
    const Array* find(std::string_view name) const;  // null where missing
    bool has(std::string_view name) const { return find(name) != nullptr; }
    void set(std::string name, Array array);  // replaces one of the same name
    void remove(std::string_view name);       // if it is there
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

}  // namespace doppel
