#include "engine/io/pictures/heif.h"

#include <OpenImageIO/tiffutils.h>
#include <libheif/heif.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include "engine/error.h"
#include "engine/io/image.h"
#include "engine/io/pictures/colours.h"

namespace doppel {

namespace {

struct Free {
    void operator()(heif_context* context) const { heif_context_free(context); }
    void operator()(heif_image_handle* handle) const { heif_image_handle_release(handle); }
    void operator()(heif_image* image) const { heif_image_release(image); }
    void operator()(heif_color_profile_nclx* profile) const {
        heif_nclx_color_profile_free(profile);
    }
};
template <typename T>
using Owned = std::unique_ptr<T, Free>;

// A profile, or three numbers of which one stands for primaries.
std::vector<uint8_t> profileIn(const heif_image_handle* handle) {
    std::vector<uint8_t> profile(heif_image_handle_get_raw_color_profile_size(handle));
    if (!profile.empty()) {
        if (heif_image_handle_get_raw_color_profile(handle, profile.data()).code != heif_error_Ok)
            profile.clear();
        return profile;
    }
    heif_color_profile_nclx* found = nullptr;
    if (heif_image_handle_get_nclx_color_profile(handle, &found).code != heif_error_Ok) return {};
    const Owned<heif_color_profile_nclx> nclx(found);
    if (nclx->color_primaries != heif_color_primaries_SMPTE_EG_432_1 &&
        nclx->color_primaries != heif_color_primaries_ITU_R_BT_2020_2_and_2100_0) {
        return {};
    }
    return profileOf({{nclx->color_primary_red_x, nclx->color_primary_red_y},
                      {nclx->color_primary_green_x, nclx->color_primary_green_y},
                      {nclx->color_primary_blue_x, nclx->color_primary_blue_y},
                      {nclx->color_primary_white_x, nclx->color_primary_white_y}});
}

// EXIF's focal length in 35 mm film; 0: it has none.
double focalLengthIn(const heif_image_handle* handle) {
    heif_item_id block = 0;
    if (heif_image_handle_get_list_of_metadata_block_IDs(handle, "Exif", &block, 1) < 1) return 0;
    std::vector<uint8_t> exif(heif_image_handle_get_metadata_size(handle, block));
    // Four bytes say how far behind them the TIFF header is.
    if (exif.size() < 4 ||
        heif_image_handle_get_metadata(handle, block, exif.data()).code != heif_error_Ok) {
        return 0;
    }
    const size_t from = 4 + (size_t{exif[0]} << 24 | size_t{exif[1]} << 16 | size_t{exif[2]} << 8 |
                             size_t{exif[3]});
    if (from >= exif.size()) return 0;
    OIIO::ImageSpec spec;
    OIIO::decode_exif(OIIO::cspan<uint8_t>(&exif[from], static_cast<ptrdiff_t>(exif.size() - from)),
                      spec);
    return spec.get_int_attribute("Exif:FocalLengthIn35mmFilm", 0);
}

class HeifFile : public PictureFile {
public:
    HeifFile(std::string name, std::span<const uint8_t> file)
        : name_(std::move(name)), context_(heif_context_alloc()) {
        if (!context_) throwMachine("{}: no memory is left to decode it", name_);
        heif_context_set_maximum_image_size_limit(context_.get(), kMaxImageSide);
        require(file.empty() ? heif_context_read_from_file(context_.get(), name_.c_str(), nullptr)
                             : heif_context_read_from_memory_without_copy(
                                   context_.get(), file.data(), file.size(), nullptr));
        heif_image_handle* handle = nullptr;
        require(heif_context_get_primary_image_handle(context_.get(), &handle));
        handle_.reset(handle);
        width = heif_image_handle_get_width(handle);
        height = heif_image_handle_get_height(handle);
        if (width < 1 || height < 1 || width > kMaxImageSide || height > kMaxImageSide)
            throwInput("{}: {} x {} pixels; expected at most {} a side", name_, width, height,
                       kMaxImageSide);
        channels = heif_image_handle_has_alpha_channel(handle) ? 4 : 3;
        bytes = true;
        profile = profileIn(handle);
        focalLength = focalLengthIn(handle);
    }

    void read(std::span<uint8_t> samples) override {
        heif_image* decoded = nullptr;
        require(heif_decode_image(
            handle_.get(), &decoded, heif_colorspace_RGB,
            channels == 4 ? heif_chroma_interleaved_RGBA : heif_chroma_interleaved_RGB, nullptr));
        const Owned<heif_image> image(decoded);
        int stride = 0;
        const uint8_t* rows =
            heif_image_get_plane_readonly(decoded, heif_channel_interleaved, &stride);
        // The coded picture may be of another size than the file says.
        if (rows == nullptr || heif_image_get_width(decoded, heif_channel_interleaved) != width ||
            heif_image_get_height(decoded, heif_channel_interleaved) != height) {
            throwInput("{}: cannot be decoded: it is not of the size that the file says", name_);
        }
        const size_t row = static_cast<size_t>(width) * static_cast<size_t>(channels);
        for (size_t y = 0; y < static_cast<size_t>(height); ++y)
            std::copy_n(rows + y * static_cast<size_t>(stride), row, &samples[y * row]);
        if (channels == 4 && heif_image_handle_is_premultiplied_alpha(handle_.get())) {
            for (size_t i = 0; i < samples.size(); i += 4) {
                const int alpha = samples[i + 3];
                for (size_t c = 0; alpha > 0 && c < 3; ++c)
                    samples[i + c] = static_cast<uint8_t>(
                        std::min(255, (255 * samples[i + c] + alpha / 2) / alpha));
            }
        }
    }
    void read(std::span<uint16_t> samples) override {
        readAs(samples, [](uint8_t value) { return static_cast<uint16_t>(257 * value); });
    }
    void read(std::span<float> samples) override {
        readAs(samples, [](uint8_t value) { return static_cast<float>(value) / 255; });
    }

private:
    void require(const heif_error& error) const {
        if (error.code != heif_error_Ok)
            throwInput("{}: cannot be decoded: {}", name_, error.message);
    }

    template <typename T, typename F>
    void readAs(std::span<T> samples, const F& as) {
        std::vector<uint8_t> eight(samples.size());
        read(std::span<uint8_t>(eight));
        std::ranges::transform(eight, samples.begin(), as);
    }

    std::string name_;
    Owned<heif_context> context_;
    Owned<heif_image_handle> handle_;
};

}  // namespace

std::unique_ptr<PictureFile> openHeif(const std::string& name, std::span<const uint8_t> file) {
    return std::make_unique<HeifFile>(name, file);
}

}  // namespace doppel
