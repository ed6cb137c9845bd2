// Masks of people, from the network's square to the picture's own edges.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "trainer/person/masks/clip_view.h"
#include "trainer/person/masks/colour_model.h"

namespace doppel {

struct CutOut {
    std::vector<uint8_t> mask;  // [H,W], 255 on the person and 0 elsewhere
    double doubtful = 0;        // pixels of which it is not sure, over the person's
};

// By one picture's share alone: where it is a half or more, or is once it has been led along the
// picture's edges (guidedFilter()). Islands far smaller than the person are left out.
CutOut cutOutAsGiven(const ClipView& view);
CutOut cutOutAlongEdges(const ClipView& view);

// What a clip tells of its person and of what is behind, beyond one picture's network: learnt from
// all pictures, then asked for each. Memory does not depend on the clip's length.
class ClipMasks {
public:
    // Views of one size.
    void learn(const ClipView& view);
    // A picture of the empty scene, of the clip's size, by the same camera, which stands still.
    void setPlate(const Image& plate) { background_.set(plate); }
    // After the last learn(). asksBehind: whether what is behind the person counts.
    void finish(bool asksBehind);

    // By the colours that each part of the person has in the whole clip and the background about
    // each place of this picture (after Rother, Kolmogorov and Blake, GrabCut, 2004, with
    // histograms, and in place of a cut a filter along edges: He, Sun and Tang, Guided Image
    // Filtering, TPAMI 2013); where the camera stands still, by what is behind each place, too.
    // Islands far smaller than the person are left out. behind: what more is known of that, as
    // MovingBackground::favour() has it, for the pixels of a rectangle that are wanted.
    using Behind =
        std::function<std::vector<float>(const Rect& rect, const std::vector<uint8_t>& wanted)>;
    CutOut cutOut(const ClipView& view, const Behind& behind = {}) const;

    const StillBackground& background() const { return background_; }
    bool usesBackground() const { return still_; }

private:
    ClipColours colours_;
    StillBackground background_;
    bool still_ = false;
};

// A mean [H,W] of `share`, by local linear models of the picture's colours: of windows of 2 radius
// + 1 pixels a side; epsilon: the variance of colours in [0, 1] below which a window is flat.
std::vector<float> guidedFilter(const Image& rgb, const std::vector<float>& share, int radius,
                                double epsilon);

}  // namespace doppel
