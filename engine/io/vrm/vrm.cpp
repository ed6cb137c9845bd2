// https://github.com/vrm-c/vrm-specification, VRMC_vrm-1.0 and VRMC_springBone-1.0
#include "engine/io/vrm/vrm.h"

// Only the declarations: the library is linked.
#define TINYGLTF_NO_INCLUDE_JSON
#define TINYGLTF_NO_INCLUDE_STB_IMAGE
#define TINYGLTF_NO_INCLUDE_STB_IMAGE_WRITE
#include <tiny_gltf.h>

namespace doppel {

namespace {

using tinygltf::Value;
using Object = Value::Object;

Value text(const char* words) { return Value(std::string(words)); }
Value number(float value) { return Value(static_cast<double>(value)); }
Value nodeOf(size_t joint) { return Value(static_cast<int>(joint) + 1); }
Value vectorOf(const std::array<float, 3>& v) {
    return Value(Value::Array{number(v[0]), number(v[1]), number(v[2])});
}

Object metaOf(const GltfVrm& vrm) {
    const VrmPermissions& may = vrm.permissions;
    Object meta{{"name", Value(vrm.name)},
                {"version", text("1")},
                {"authors", Value(Value::Array{Value(vrm.author)})},
                {"licenseUrl", text("https://vrm.dev/licenses/1.0/")},
                {"avatarPermission", Value(may.wearer)},
                {"allowExcessivelyViolentUsage", Value(may.violence)},
                {"allowExcessivelySexualUsage", Value(may.sexual)},
                {"commercialUsage", Value(may.commercial)},
                {"allowPoliticalOrReligiousUsage", Value(may.politics)},
                {"allowAntisocialOrHateUsage", Value(may.hate)},
                {"creditNotation", Value(may.credit)},
                {"allowRedistribution", Value(may.redistribution)},
                {"modification", Value(may.modification)}};
    if (!vrm.licence.empty()) meta["otherLicenseUrl"] = Value(vrm.licence);
    return meta;
}

Object colliderOf(const VrmSpring::Collider& collider) {
    const Object capsule{{"offset", vectorOf(collider.from)},
                         {"tail", vectorOf(collider.to)},
                         {"radius", number(collider.radius)}};
    return {{"node", nodeOf(collider.joint)},
            {"shape", Value(Object{{"capsule", Value(capsule)}})}};
}

Object springJointOf(size_t joint, float thickness) {
    // Hair that falls back within half a second and hangs rather than stands.
    constexpr float kStiffness = .6f, kGravity = .3f, kDrag = .4f;
    return {{"node", nodeOf(joint)},
            {"hitRadius", number(thickness)},
            {"stiffness", number(kStiffness)},
            {"gravityPower", number(kGravity)},
            {"gravityDir", vectorOf({0, -1, 0})},
            {"dragForce", number(kDrag)}};
}

Object springBoneOf(const std::vector<VrmSpring>& springs) {
    Value::Array colliders, groups, all;
    for (const VrmSpring& spring : springs) {
        Value::Array own, joints;
        for (const VrmSpring::Collider& collider : spring.colliders) {
            own.emplace_back(static_cast<int>(colliders.size()));
            colliders.emplace_back(colliderOf(collider));
        }
        for (const size_t joint : spring.joints)
            joints.emplace_back(springJointOf(joint, spring.thickness));
        Object object{{"name", Value(spring.name)}, {"joints", Value(joints)}};
        if (!own.empty()) {
            object["colliderGroups"] = Value(Value::Array{Value(static_cast<int>(groups.size()))});
            groups.emplace_back(Object{{"colliders", Value(own)}});
        }
        all.emplace_back(object);
    }
    Object extension{{"specVersion", text("1.0")}, {"springs", Value(all)}};
    if (!colliders.empty()) {
        extension["colliders"] = Value(colliders);
        extension["colliderGroups"] = Value(groups);
    }
    return extension;
}

}  // namespace

void addVrm(tinygltf::Model& model, const GltfVrm& vrm) {
    Object bones;
    for (const auto& [bone, joint] : vrm.bones)
        bones[bone] = Value(Object{{"node", nodeOf(joint)}});
    model.extensions["VRMC_vrm"] =
        Value(Object{{"specVersion", text("1.0")},
                     {"meta", Value(metaOf(vrm))},
                     {"humanoid", Value(Object{{"humanBones", Value(bones)}})}});
    model.extensionsUsed.push_back("VRMC_vrm");
    if (vrm.springs.empty()) return;
    model.extensions["VRMC_springBone"] = Value(springBoneOf(vrm.springs));
    model.extensionsUsed.push_back("VRMC_springBone");
}

}  // namespace doppel
