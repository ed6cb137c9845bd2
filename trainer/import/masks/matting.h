// People cut out by a network of the user's own, run by OpenCV's dnn where Doppel was built with
// it.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "engine/io/image.h"

namespace doppel {

// What a network takes, RGB as [1,3,H,W], and what it gives, [1,1,H,W] from 0 to 1.
enum class MattingKind : uint8_t {
    Modnet,  // 512×512, colours from −1 to 1 (MODNet)
    Isnet,   // 1024×1024, colours from −.5 to .5 (ISNet, of DIS)
};

class MattingNetwork {
public:
    // kind: "modnet" or "isnet". InputError where the file is no ONNX network with one input that
    // OpenCV can run, where the kind is another word, and where this build has no OpenCV.
    MattingNetwork(const std::filesystem::path& file, std::string_view kind);
    ~MattingNetwork();

    // [H,W] of the picture: how surely each pixel is somebody's, [0, 1].
    std::vector<float> share(const Image& rgb);

    const std::string& name() const { return name_; }  // of the file

    static bool available();  // in this build

private:
    struct Net;
    std::string name_, path_;
    MattingKind kind_;
    std::unique_ptr<Net> net_;
};

}  // namespace doppel
