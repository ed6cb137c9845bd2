// The loss terms of a training step: one line per term sums it, averages it over the batch, and
// brings it into the curves and the progress line.
//
//     for (frame of the batch) {
//         losses.term("iou_loss", preset.silhouette, silhouetteIouLoss(...));
//         losses.term("laplacian", preset.laplacian, laplacianLoss(...));
//     }
//     graph.backward(losses.sum());
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "nn/core/graph.h"

namespace doppel {

class Losses {
public:
    explicit Losses(Graph& graph) : graph_(graph) {}

    // Adds a number [] to the term of this name, which is the mean of what was added to it: a
    // frame's part, or the whole batch's at once.
    void term(std::string_view name, double weight, const Tensor& value);

    // Σ weight · term, over the terms in the order of their first parts; comes after them. The sum
    // and the terms become outputs of the graph.
    Tensor sum();

    // Lists another sum's terms behind these: those of networks that the same step trains.
    void append(const Losses& other);

    // "loss" for the sum, then the terms.
    std::vector<std::string> names() const;
    // Their values in the newest replay, or in the one before it (back = 1); waits for it.
    std::vector<double> read(int back = 0) const;
    // One of them; an empty tensor where there is none of this name.
    Tensor find(std::string_view name) const;

private:
    struct Term {
        std::string name;
        float weight = 0;
        std::vector<Tensor> parts;
        Tensor mean;
    };
    Graph& graph_;
    std::vector<Term> terms_;
    Tensor sum_;
};

}  // namespace doppel
