// Fields of estimators' files as poses: shapes and numbers are checked before they are used.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "trainer/motion/estimates/estimate.h"

namespace doppel {

// Numbers [rows][width] of one field.
struct Rows {
    std::string where;  // file and field
    size_t width = 0;
    std::vector<double> values;

    size_t size() const { return values.size() / width; }
    std::span<const double> operator[](size_t row) const {
        return std::span(values).subspan(row * width, width);
    }
};

// An array of whatever shape as rows of its first dimension. InputError where a row has not `width`
// numbers, there are not `rows` of them (0: any number but none), or a number is not finite or
// beyond ±most.
Rows rowsOf(const Array& array, size_t width, size_t rows = 0, double most = kMostMetres);
Rows rowsOf(const Tensor32& tensor, const std::string& where, size_t width, size_t rows = 0,
            double most = kMostMetres);

// Rotations of `joints` joints per row: axis-angle [R, 3 joints] or matrices [R, 9 joints].
// InputError where it is neither, or a matrix is no rotation.
struct Rotations {
    size_t joints = 0;
    std::vector<glm::dquat> values;  // [R][joints]
    size_t size() const { return values.size() / joints; }
};
Rotations rotationsOf(const Array& array, size_t joints, size_t rows = 0);
// Of the first `joints` joints, where the file has at least so many.
Rotations firstRotationsOf(const Array& array, size_t joints, size_t rows = 0);

// Numbers of pictures, from 0. InputError: not whole, negative, or there are not `rows` of them.
std::vector<int64_t> pictureNumbers(const Array& array, size_t rows);

// The mean of rows of shape coefficients: the first ten, zeros where there are fewer.
std::optional<Betas> meanBetas(const Rows& rows);

void setRotations(Theta& theta, size_t joint, std::span<const glm::dquat> rotations);

// Where the pelvis of a body is whose program turns it about its pelvis `rest` and then moves it.
inline glm::dvec3 restPelvis() { return {kRestPelvis[0], kRestPelvis[1], kRestPelvis[2]}; }
// SMPL-X's pelvis in its rest pose, metres, for the mean shape.
inline glm::dvec3 smplxPelvis() { return {.0031, -.3514, .0120}; }

// "clip/000012.jpg" → "000012".
std::string pictureStem(std::string_view path);

}  // namespace doppel
