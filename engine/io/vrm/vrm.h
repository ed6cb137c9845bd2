// What makes a glTF file a VRM 1.0 avatar: who may do what with it, which joints are which bones,
// and joints that swing by themselves.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace tinygltf {
class Model;
}

namespace doppel {

// VRM's own words and questions, each with the answer that allows least: it shows a person.
struct VrmPermissions {
    std::string wearer = "onlyAuthor";             // onlySeparatelyLicensedPerson, everyone
    std::string commercial = "personalNonProfit";  // personalProfit, corporation
    std::string modification = "prohibited";  // allowModification, allowModificationRedistribution
    std::string credit = "required";          // unnecessary
    bool violence = false, sexual = false, politics = false, hate = false, redistribution = false;
};

// Joints that swing, each hanging on the one before; the last one only says where they end.
struct VrmSpring {
    struct Collider {
        size_t joint = 0;
        std::array<float, 3> from = {}, to = {};  // metres, from the joint
        float radius = 0;
    };
    std::string name;
    std::vector<size_t> joints;
    float thickness = 0;  // metres around a joint
    std::vector<Collider> colliders;
};

struct GltfVrm {
    std::string name, author;
    std::string licence;  // a page's address, beside VRM's own licence; may be empty
    VrmPermissions permissions;
    // Which joints are VRM's bones: "leftUpperLeg" and the joint's number.
    std::vector<std::pair<std::string, size_t>> bones;
    std::vector<VrmSpring> springs;
};

// VRMC_vrm, without expressions, and VRMC_springBone where something swings. Joint j is
// the model's node j + 1.
void addVrm(tinygltf::Model& model, const GltfVrm& vrm);

}  // namespace doppel
