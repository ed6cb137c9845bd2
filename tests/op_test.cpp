#include "tests/op_test.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <memory>
#include <random>

namespace doppel {

namespace {

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
        std::vector<std::string> messages = Device::validationMessages();
        for (; seen_ < messages.size(); ++seen_) ADD_FAILURE() << "validation: " << messages[seen_];
    }
    size_t seen_ = 0;
};

}  // namespace

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

        std::vector<size_t> elements(gradient.size());
        std::iota(elements.begin(), elements.end(), size_t{0});
        std::shuffle(elements.begin(), elements.end(), std::mt19937(7));
        std::vector<double> computed, differences;
        Values values = toValues(testCase);
        for (size_t element : elements) {
            if (static_cast<int>(computed.size()) == testCase.samples) break;
            if (testCase.skip && testCase.skip(input.name, static_cast<int64_t>(element))) continue;
            double& x = values.at(input.name).data[element];
            double keep = x, h = testCase.differenceStep;
            x = keep + h;
            double above = projection(values);
            x = keep - h;
            double below = projection(values);
            x = keep;
            computed.push_back(gradient[element]);
            differences.push_back((above - below) / (2 * h));
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

// By precision. main() destroys them: newer validation layers do not outlive it, as statics would.
static std::map<Precision, std::unique_ptr<Device>> devices;

Device& testDevice(Precision precision) {
    std::unique_ptr<Device>& device = devices[precision];
    // A missing device throws, and that fails the test.
    if (!device) device = std::make_unique<Device>(DeviceOptions{.precision = precision});
    return *device;
}

}  // namespace doppel

int main(int argc, char** argv) {
    testing::InitGoogleTest(&argc, argv);
    setenv("DOPPEL_VALIDATION", "1", 0);
    setenv("DOPPEL_MATRIX_UNITS", "emulated", 0);
    testing::UnitTest::GetInstance()->listeners().Append(new doppel::ValidationIsSilent);
    int failed = RUN_ALL_TESTS();
    doppel::devices.clear();
    return failed;
}
