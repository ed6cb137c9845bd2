// One texture for all views, of the refined textures that the networks paint for each.
#pragma once

#include <span>
#include <vector>

#include "engine/device.h"
#include "nn/body/texel_places.h"
#include "trainer/avatar/avatar.h"

namespace doppel {

// Where a texel's first colour came from, as a grey that tells it.
enum TexelOrigin : uint8_t {
    kNoTexel = 0,          // between the charts
    kFromNeighbours = 85,  // no frame shows it, nor its mirror image
    kFromOtherSide = 170,  // of the body: no frame shows it
    kFromFrames = 255,
};

// Gives the texels between the charts of a texture [size,size,3] the colour of the nearest chart.
void spreadCharts(std::span<const TexelPlace> places, int size, std::vector<float>& texture);

// How much a view of the mesh (verts [V,3], camera space) says about each texel: the fourth power
// of the cosine between the smooth normal and the direction to the camera; 0 where it faces away.
std::vector<float> viewWeights(const BodyModel& body, std::span<const TexelPlace> places,
                               std::span<const float> verts);

// Weighted mean of textures [size,size,3], one per view, added up as they come.
//
// A texel that no view faces keeps the `rest` texture's colour, and one that few face takes a part
// of it. The weights depend on the place on the mesh alone, so that the two sides of a seam are
// mixed alike; texels between the charts take the colour of the nearest chart.
class TextureBaker {
public:
    TextureBaker(const BodyModel& body, int size);
    void add(std::span<const float> texture, std::span<const float> verts);
    std::vector<float> result(std::span<const float> rest) const;

private:
    const BodyModel& body_;
    int size_;
    std::vector<TexelPlace> places_;
    std::vector<double> sums_, weights_;
};

// Fills avatar.bakedTexture from the refined textures for these meshes (camera space).
void bakeTexture(Device& device, Avatar& avatar, const std::vector<std::vector<float>>& views);

}  // namespace doppel
