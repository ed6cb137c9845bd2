#include "nn/steps/losses.h"

#include <algorithm>

#include "nn/ops/fit.h"

namespace doppel {

void Losses::term(std::string_view name, double weight, const Tensor& value) {
    CHECK(!sum_, "loss term {} comes after the sum", name);
    CHECK(value.elements() == 1, "loss term {} is one number, not {}", name, value.elements());
    auto there = std::ranges::find(terms_, name, &Term::name);
    if (there == terms_.end())
        there =
            terms_.insert(terms_.end(), {std::string(name), static_cast<float>(weight), {}, {}});
    CHECK(there->weight == static_cast<float>(weight), "loss term {} has two weights", name);
    there->parts.push_back(value);
}

Tensor Losses::sum() {
    CHECK(!sum_ && !terms_.empty(), "losses are summed once, and are some");
    std::vector<WeightedTerm> weighted;
    for (Term& term : terms_) {
        std::vector<WeightedTerm> parts;
        for (const Tensor& part : term.parts)
            parts.push_back({part, 1.0f / static_cast<float>(term.parts.size())});
        term.mean = parts.size() == 1 ? term.parts[0] : weightedSum(graph_, parts);
        weighted.push_back({term.mean, term.weight});
    }
    sum_ = weightedSum(graph_, weighted);
    graph_.output(sum_);
    for (const Term& term : terms_) graph_.output(term.mean);
    return sum_;
}

void Losses::append(const Losses& other) {
    CHECK(other.sum_, "only a finished sum is appended");
    terms_.insert(terms_.end(), other.terms_.begin(), other.terms_.end());
}

std::vector<std::string> Losses::names() const {
    std::vector<std::string> names{"loss"};
    for (const Term& term : terms_) names.push_back(term.name);
    return names;
}

std::vector<double> Losses::read(int back) const {
    std::vector<double> values{static_cast<double>(graph_.readScalar(sum_, back))};
    for (const Term& term : terms_)
        values.push_back(static_cast<double>(graph_.readScalar(term.mean, back)));
    return values;
}

Tensor Losses::find(std::string_view name) const {
    if (name == "loss") return sum_;
    auto there = std::ranges::find(terms_, name, &Term::name);
    return there == terms_.end() ? Tensor() : there->mean;
}

}  // namespace doppel
