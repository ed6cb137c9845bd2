#include "trainer/train.h"
#include "trainer/evaluate.h"
#include "trainer/synthetic.h"
#include <chrono>
#include <numeric>
using namespace doppel;
static double mean(const std::vector<double>& v) { return std::accumulate(v.begin(), v.end(), 0.0) / double(v.size()); }
int main(int argc, char** argv) {
    try {
        Device device{};
        Capture c = readCapture(argv[1]);
        Avatar a; a.bodyArrays = readBodyArrays("default"); a.body = bodyFromNpz(a.bodyArrays);
        a.preset = presetByName(argv[2]); a.betas = c.betas;
        TrainSettings s; s.out = argv[3]; s.pictureSeconds = 0; s.stages = {"mesh", "texture"};
        for (int i = 4; i < argc; ++i) { std::string t = argv[i]; if (t.starts_with("profile=")) { s.profileSteps = std::stoi(t.substr(8)); continue; } if (t.starts_with("stages=")) { s.stages.clear(); if (t.find("fit") != t.npos) s.stages.push_back("fit"); if (t.find("mesh") != t.npos) s.stages.push_back("mesh");  if (t.find("texture") != t.npos) s.stages.push_back("texture"); continue; }
          setPresetValue(a.preset, t.substr(0,t.find('=')), t.substr(t.find('=')+1), "x"); }
        auto t0 = std::chrono::steady_clock::now();
        TrainResult r = trainAvatar(device, a, c, s);
        fmt::print("{:.1f}s\n", std::chrono::duration<double>(std::chrono::steady_clock::now()-t0).count());
        if (s.profileSteps) return 0;
        fmt::print("iou unrefined {:.4f} refined {:.4f}\n", mean(avatarIous(device, r.avatar, r.capture, false)), mean(avatarIous(device, r.avatar, r.capture, true)));
        if (!r.avatar.texture.empty()) { auto m = meanMetrics(evaluateAvatar(device, r.avatar, r.capture, std::filesystem::path(argv[3]) / "pictures")); fmt::print("psnr {:.2f} ssim {:.3f}\n", m.psnrBody, m.ssimFrame); }
    } catch (const std::exception& e) { fmt::print("{}\n", e.what()); return 1; }
}
