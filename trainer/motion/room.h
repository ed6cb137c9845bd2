// A furnished room, drawn by ray casting: a background with much in it, for synthetic clips.
#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

namespace doppel {

// In metres, x to the right, y down, z away from the viewer, who looks into it from about the
// origin. Walls, floor, shelves with books, a curtain, pictures, a rug, boxes: some of it has the
// colours of skin and clothes. The same seed gives the same room.
class Room {
public:
    static constexpr double kFloor = 1.15;  // y of the floor
    static constexpr double kBack = 4.6;    // z of the wall

    explicit Room(uint64_t seed);

    // sRGB-encoded, [0,1], where the ray first meets the room. feet: points on the floor around
    // which people's shadows lie.
    std::array<float, 3> colour(const glm::dvec3& origin, const glm::dvec3& direction,
                                const std::vector<glm::dvec3>& feet) const;

private:
    enum class Look : uint8_t {
        Wallpaper,
        Boards,
        Plaster,
        Books,
        Wood,
        Cloth,
        Picture,
        Rug,
        Leaf
    };
    struct Box {
        glm::dvec3 low, high;
        Look look;
        uint64_t seed;
    };
    glm::dvec3 lookOf(Look look, uint64_t seed, double u, double v) const;

    uint64_t seed_;
    std::vector<Box> boxes_;
};

}  // namespace doppel
