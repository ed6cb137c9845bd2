#include "tests/op_test.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <map>
#include <memory>
#include <numeric>
#include <random>
#include <set>

#include "engine/kernel_log.h"

#include "engine/instance.h"

namespace doppel {

namespace {

// Names of the ops that went through checkOp().
std::set<std::string> checkedOps;

Npz toArrays(const OpCase& testCase) {
    Npz arrays;
    for (const auto& [name, value] : testCase.inputs)
        arrays.set(name, Array::f64(value.shape, value.data));
    for (const auto& [name, value] : testCase.integers) {
        std::vector<int32_t> integers(value.data.begin(), value.data.end());
        arrays.set(name, Array::i32(value.shape, integers));
    }
    for (const auto& [name, value] : testCase.attributes)
        arrays.set("attr_" + name, Array::scalarF64(value));
    return arrays;
}

Values toValues(const OpCase& testCase) {
    Values values = testCase.inputs;
    values.insert(testCase.integers.begin(), testCase.integers.end());
    for (const auto& [name, value] : testCase.attributes) values[name] = {{}, {value}};
    return values;
}

// Inputs as the device sees them, so that rounding them to float is no error of the op.
void roundToFloat(Values& values) {
    for (auto& [name, value] : values)
        for (double& x : value.data) x = static_cast<double>(static_cast<float>(x));
}

class ValidationIsSilent : public testing::EmptyTestEventListener {
    void OnTestEnd(const testing::TestInfo&) override {
        std::vector<std::string> messages = validationMessages();
        for (; seen_ < messages.size(); ++seen_) ADD_FAILURE() << "validation: " << messages[seen_];
    }
    size_t seen_ = 0;
};

}  // namespace

std::vector<int64_t> edgeSizes(int64_t tile) {
    std::set<int64_t> sizes{1, tile, tile + 1, 3 * tile + tile / 2 + 1};
    if (tile > 1) sizes.insert(tile - 1);
    return {sizes.begin(), sizes.end()};
}

Value random(Shape shape, uint32_t seed) {
    std::mt19937 generator(seed);
    std::normal_distribution<double> normal;
    Value value{shape, std::vector<double>(static_cast<size_t>(elementCount(shape)))};
    std::ranges::generate(value.data, [&] { return normal(generator); });
    return value;
}

Value uniform(Shape shape, double low, double high, uint32_t seed) {
    std::mt19937 generator(seed);
    std::uniform_real_distribution<double> distribution(low, high);
    Value value{shape, std::vector<double>(static_cast<size_t>(elementCount(shape)))};
    std::ranges::generate(value.data, [&] { return distribution(generator); });
    return value;
}

Value indices(Shape shape, std::vector<int> values) {
    return {std::move(shape), {values.begin(), values.end()}};
}

double relativeError(const std::vector<double>& a, const std::vector<double>& b, double floor) {
    double difference = 0, norm = 0;
    for (size_t i = 0; i < b.size(); ++i) {
        if (!std::isfinite(a[i])) return INFINITY;
        difference += (a[i] - b[i]) * (a[i] - b[i]);
        norm += b[i] * b[i];
    }
    return std::sqrt(difference) / std::max(std::sqrt(norm), floor);
}

void checkOp(const std::string& opName, const OpCase& original) {
    SCOPED_TRACE("op " + opName);
    const Op* op = Op::find(opName);
    ASSERT_NE(op, nullptr);
    checkedOps.insert(opName);
    OpCase testCase = original;
    roundToFloat(testCase.inputs);
    CompileOptions options;
    options.reuseMemory = false;
    options.poison = true;

    // Forward.
    Values expected = testCase.reference(toValues(testCase));
    Npz arrays = toArrays(testCase);
    Npz got = op->run(testDevice(original.precision), arrays, options);
    for (const auto& [name, value] : expected) {
        ASSERT_TRUE(got.has(name)) << "output " << name;
        ASSERT_EQ(got.at(name).shape, value.shape) << "output " << name;
        EXPECT_LE(relativeError(got.at(name).toF64(), value.data, testCase.floor),
                  testCase.forwardTolerance)
            << "output " << name;
    }

    // Backward of <outputs, random upstream>.
    if (op->declaration().differentiable.empty()) return;
    Values upstream;
    uint32_t seed = 1000;
    for (const auto& [name, value] : expected) {
        if (std::ranges::count(testCase.constantOutputs, name)) continue;
        upstream[name] = random(value.shape, ++seed);
    }
    roundToFloat(upstream);
    for (const auto& [name, value] : upstream)
        arrays.set("grad_" + name, Array::f64(value.shape, value.data));
    got = op->run(testDevice(original.precision), arrays, options);

    auto projection = [&](const Values& values) {
        Values outputs = testCase.reference(values);
        double sum = 0;
        for (const auto& [name, value] : upstream)
            for (size_t i = 0; i < value.data.size(); ++i)
                sum += value.data[i] * outputs.at(name).data[i];
        return sum;
    };
    for (const Op::Input& input : op->inputs()) {
        if (!input.differentiable || !testCase.inputs.contains(input.name)) continue;
        ASSERT_TRUE(got.has("grad_" + input.name)) << "gradient of " << input.name;
        std::vector<double> gradient = got.at("grad_" + input.name).toF64();
        ASSERT_EQ(gradient.size(), testCase.inputs.at(input.name).data.size());
        for (double g : gradient) ASSERT_TRUE(std::isfinite(g)) << "gradient of " << input.name;

        auto skipped = [&](size_t element) {
            return testCase.skip && testCase.skip(input.name, static_cast<int64_t>(element));
        };
        // Of <outputs, upstream> along a direction of this input.
        auto differenceAlong = [&](const std::vector<std::pair<size_t, double>>& direction) {
            Values values = toValues(testCase);
            std::vector<double>& x = values.at(input.name).data;
            const std::vector<double>& at = testCase.inputs.at(input.name).data;
            double h = testCase.differenceStep;
            for (auto [element, d] : direction) x[element] = at[element] + h * d;
            double above = projection(values);
            for (auto [element, d] : direction) x[element] = at[element] - h * d;
            return (above - projection(values)) / (2 * h);
        };

        // All elements at once.
        std::mt19937 generator(++seed);
        std::uniform_real_distribution<double> magnitude(0.5, 1);
        std::vector<std::pair<size_t, double>> direction;
        double along = 0, norm = 0;
        for (size_t i = 0; i < gradient.size(); ++i) {
            double d = generator() % 2 ? magnitude(generator) : -magnitude(generator);
            if (skipped(i)) continue;
            direction.emplace_back(i, d);
            along += gradient[i] * d;
            norm += gradient[i] * gradient[i];
        }
        EXPECT_LE(std::abs(along - differenceAlong(direction)) /
                      std::max(std::sqrt(norm), testCase.floor),
                  testCase.directionTolerance)
            << "gradient of " << input.name << " along a random direction";

        // The first and the last element, and random ones.
        std::vector<size_t> elements;
        for (auto [element, d] : direction) elements.push_back(element);
        std::shuffle(elements.begin(), elements.end(), std::mt19937(7));
        for (size_t edge : {gradient.size(), size_t{1}})
            if (auto found = std::ranges::find(elements, edge - 1); found != elements.end())
                std::rotate(elements.begin(), found, found + 1);
        elements.resize(std::min(elements.size(), static_cast<size_t>(testCase.samples)));
        std::vector<double> computed, differences;
        for (size_t element : elements) {
            computed.push_back(gradient[element]);
            differences.push_back(differenceAlong({{element, 1.0}}));
        }
        EXPECT_LE(relativeError(computed, differences, testCase.floor), testCase.gradientTolerance)
            << "gradient of " << input.name;
    }
}

void expectInputError(const std::function<void()>& run, const std::string& words) {
    try {
        run();
        ADD_FAILURE() << "no error; expected one with: " << words;
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find(words), std::string::npos) << error.what();
    }
}

// By precision, and by rank. main() destroys them: newer validation layers do not outlive it, as
// statics would.
static std::map<Precision, std::unique_ptr<Device>> devices;
static std::vector<std::unique_ptr<Device>> devicesOfRanks;

// A missing device throws, and that fails the test.
static std::unique_ptr<Device> makeDevice(Precision precision) {
    const char* name = std::getenv("DOPPEL_DEVICE");
    return std::make_unique<Device>(
        DeviceOptions{.name = name ? name : "", .precision = precision});
}

Device& testDevice(Precision precision) {
    std::unique_ptr<Device>& device = devices[precision];
    if (!device) device = makeDevice(precision);
    return *device;
}

std::vector<Device*> rankDevices(int count) {
    while (devicesOfRanks.size() < static_cast<size_t>(count))
        devicesOfRanks.push_back(makeDevice(Precision::Single));
    std::vector<Device*> found;
    for (int rank = 0; rank < count; ++rank)
        found.push_back(devicesOfRanks[static_cast<size_t>(rank)].get());
    return found;
}

}  // namespace doppel

// DOPPEL_KERNEL_LOG names a file for what all tests of a program covered, which test_kernels reads:
// kernels by flavour and ops, one a line. A part of the tests, or one that failed, leaves no file.
static void writeCoverage(const std::string& path) {
    std::ofstream file(path);
    for (const std::string& kernel : doppel::notedKernels()) file << "kernel " << kernel << "\n";
    for (const std::string& op : doppel::checkedOps) file << "op " << op << "\n";
}

int main(int argc, char** argv) {
    doppel::separateShaderCaches();
    testing::InitGoogleTest(&argc, argv);
    const char* coverage = std::getenv("DOPPEL_KERNEL_LOG");
    if (coverage) std::remove(coverage);
    setenv("DOPPEL_VALIDATION", "1", 0);
    setenv("DOPPEL_MATRIX_UNITS", "emulated", 0);
    testing::UnitTest::GetInstance()->listeners().Append(new doppel::ValidationIsSilent);
    int failed = RUN_ALL_TESTS();
    doppel::devicesOfRanks.clear();
    doppel::devices.clear();
    if (coverage && failed == 0) writeCoverage(coverage);
    return failed;
}
