#include "tests/op_test.h"

namespace doppel {
namespace {

// One input x, one output y of the same shape.
Values mapX(const Values& v, const std::function<double(double)>& f) {
    Value y = v.at("x");
    for (double& value : y.data) value = f(value);
    return {{"y", y}};
}

TEST(Elementwise, LeakyRelu) {
    for (Shape shape : {Shape{1}, Shape{13}, Shape{2, 3, 127}})
        checkOp("leaky_relu", {.inputs = {{"x", random(shape)}},
                               .attributes = {{"slope", 0.2}},
                               .reference = [](const Values& v) {
                                   double slope = v.at("slope").data[0];
                                   return mapX(v, [&](double x) { return x > 0 ? x : slope * x; });
                               }});
}

}  // namespace
}  // namespace doppel
