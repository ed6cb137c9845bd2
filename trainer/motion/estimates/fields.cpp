#include "trainer/motion/estimates/fields.h"

#include <algorithm>
#include <cmath>

#include "engine/error.h"
#include "engine/files/printable.h"

namespace doppel {

namespace {

constexpr size_t kMostRows = 10'000'000;

size_t countOf(std::span<const int64_t> shape) {
    size_t count = 1;
    for (const int64_t size : shape) count *= static_cast<size_t>(size);
    return count;
}

Rows checkedRows(std::string where, std::span<const int64_t> shape, std::vector<double> values,
                 size_t width, size_t rows, double most) {
    const size_t found = shape.empty() ? 0 : static_cast<size_t>(shape[0]);
    const size_t wide = shape.empty() ? 0 : countOf(shape.subspan(1));
    if (found == 0 || found > kMostRows || wide != width) {
        std::string sizes;
        for (const int64_t size : shape)
            sizes += fmt::format("{}{}", sizes.empty() ? "" : ", ", size);
        throwInput("{}: expected {} numbers in each of one row or more, found the shape [{}]",
                   where, width, sizes);
    }
    if (rows > 0 && found != rows)
        throwInput("{}: expected {} rows, one per pose, found {}", where, rows, found);
    for (size_t i = 0; i < values.size(); ++i) {
        if (!std::isfinite(values[i]))
            throwInput("{}: expected finite numbers, found {} in row {}, element {}", where,
                       values[i], i / width, i % width);
        if (std::abs(values[i]) > most)
            throwInput("{}: expected numbers from {} to {}, found {} in row {}, element {}", where,
                       -most, most, values[i], i / width, i % width);
    }
    return {std::move(where), width, std::move(values)};
}

glm::dquat rotationFrom(std::span<const double> m, const std::string& where, size_t row) {
    const glm::dmat3 matrix(m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]);  // by columns
    const glm::dmat3 square = glm::transpose(matrix) * matrix;
    double off = std::abs(glm::determinant(matrix) - 1);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) off = std::max(off, std::abs(square[i][j] - (i == j)));
    if (off > .05)
        throwInput("{}: expected rotation matrices, found one that is none in row {}", where, row);
    return glm::normalize(glm::quat_cast(matrix));
}

}  // namespace

Rows rowsOf(const Array& array, size_t width, size_t rows, double most) {
    return checkedRows(array.where, array.shape, array.toF64(), width, rows, most);
}

Rows rowsOf(const Tensor32& tensor, const std::string& where, size_t width, size_t rows,
            double most) {
    return checkedRows(where, tensor.shape, {tensor.values.begin(), tensor.values.end()}, width,
                       rows, most);
}

Rotations rotationsOf(const Array& array, size_t joints, size_t rows) {
    const size_t found = array.shape.empty() ? 0 : static_cast<size_t>(array.shape[0]);
    const bool matrices = found > 0 && static_cast<size_t>(array.count()) == found * 9 * joints;
    const Rows numbers =
        rowsOf(array, (matrices ? 9 : 3) * joints, rows, matrices ? 2. : kMostRadians);
    Rotations result{joints, {}};
    result.values.reserve(numbers.size() * joints);
    for (size_t r = 0; r < numbers.size(); ++r)
        for (size_t j = 0; j < joints; ++j)
            if (matrices) {
                result.values.push_back(
                    rotationFrom(numbers[r].subspan(9 * j, 9), numbers.where, r));
            } else {
                const auto v = numbers[r].subspan(3 * j, 3);
                result.values.push_back(quaternionOf({v[0], v[1], v[2]}));
            }
    return result;
}

Rotations firstRotationsOf(const Array& array, size_t joints, size_t rows) {
    const size_t found = array.shape.empty() ? 0 : static_cast<size_t>(array.shape[0]);
    const size_t wide = found > 0 ? static_cast<size_t>(array.count()) / found : 0;
    if (wide % 3 != 0 || wide < 3 * joints)
        throwInput("{}: expected axis-angle of {} joints or more, found the shape {}", array.where,
                   joints, array.shapeText());
    const Rows numbers = rowsOf(array, wide, rows, kMostRadians);
    Rotations result{joints, {}};
    for (size_t r = 0; r < numbers.size(); ++r)
        for (size_t j = 0; j < joints; ++j) {
            const auto v = numbers[r].subspan(3 * j, 3);
            result.values.push_back(quaternionOf({v[0], v[1], v[2]}));
        }
    return result;
}

std::vector<int64_t> pictureNumbers(const Array& array, size_t rows) {
    const Rows numbers = rowsOf(array, 1, rows, 1e9);
    std::vector<int64_t> result;
    for (const double number : numbers.values) {
        if (number < 0 || number != std::floor(number))
            throwInput("{}: expected numbers of pictures, from 0, found {}", numbers.where, number);
        result.push_back(static_cast<int64_t>(number));
    }
    return result;
}

std::optional<Betas> meanBetas(const Rows& rows) {
    Betas betas{};
    for (size_t k = 0; k < std::min(betas.size(), rows.width); ++k) {
        double sum = 0;
        for (size_t r = 0; r < rows.size(); ++r) sum += rows[r][k];
        betas[k] = static_cast<float>(sum / static_cast<double>(rows.size()));
    }
    return betas;
}

void setRotations(Theta& theta, size_t joint, std::span<const glm::dquat> rotations) {
    for (const glm::dquat& rotation : rotations) setJointRotation(theta, joint++, rotation);
}

std::string pictureStem(std::string_view path) {
    const size_t slash = path.find_last_of("/\\");
    if (slash != std::string_view::npos) path.remove_prefix(slash + 1);
    return std::string(path.substr(0, std::min(path.rfind('.'), path.size())));
}

}  // namespace doppel
