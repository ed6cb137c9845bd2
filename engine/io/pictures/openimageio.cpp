// The module doppel-pictures.so: PictureCodecs by OpenImageIO, JPEGs by libjpeg-turbo, which
// decodes no more of them than is asked for, and HEIC by libheif.
#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <turbojpeg.h>

#include <cctype>
#include <cstring>
#include <string_view>

#include "engine/error.h"
#include "engine/io/image.h"
#include "engine/io/pictures/codecs.h"
#include "engine/io/pictures/colours.h"
#include "engine/io/pictures/heif.h"

namespace doppel {

namespace {

using OIIO::ImageInput;
using OIIO::ImageOutput;
using OIIO::ImageSpec;
using OIIO::TypeDesc;
using OIIO::Filesystem::IOProxy;

// Of a rendered frame level 3 makes a few percent more bytes than 6, in half the time.
constexpr int kPngLevel = 3;

std::string oneLine(std::string text) {
    while (!text.empty() && std::isspace(static_cast<unsigned char>(text.back()))) text.pop_back();
    for (char& c : text) {
        if (static_cast<unsigned char>(c) < 32) c = ' ';
    }
    if (text.size() > 200) text.resize(200);
    return text.empty() ? "the file is damaged or cut short" : text;
}

class OiioFile : public PictureFile {
public:
    OiioFile(const char* format, std::string name, std::unique_ptr<IOProxy> proxy)
        : name_(std::move(name)), proxy_(std::move(proxy)), input_(ImageInput::create(format)) {
        if (!input_) {
            OIIO::geterror();  // clears it
            throwInput("{}: this OpenImageIO cannot read {}", name_, format);
        }
        ImageSpec config, spec;
        config.attribute("oiio:UnassociatedAlpha", 1);
        input_->set_ioproxy(proxy_.get());
        const std::string fileName = proxy_->filename().empty() ? name_ : proxy_->filename();
        if (!input_->open(fileName, spec, config)) {
            throwInput("{}: cannot be read as {}: {}", name_, format, oneLine(input_->geterror()));
        }
        if (spec.width < 1 || spec.height < 1 || spec.width > kMaxImageSide ||
            spec.height > kMaxImageSide || spec.depth > 1) {
            throwInput("{}: {} x {} pixels; expected at most {} a side", name_, spec.width,
                       spec.height, kMaxImageSide);
        }
        if (spec.nchannels < 1 || spec.nchannels > 4 || spec.deep) {
            throwInput("{}: {} channels; expected 1 to 4", name_, spec.nchannels);
        }
        width = spec.width;
        height = spec.height;
        channels = spec.nchannels;
        orientation = spec.get_int_attribute("Orientation", 1);
        if (orientation < 1 || orientation > 8) orientation = 1;
        floats = spec.format.is_floating_point();
        bytes = spec.format == TypeDesc::UINT8;
        const std::string_view space(spec.get_string_attribute("oiio:ColorSpace").c_str());
        linear = std::strcmp(format, "openexr") == 0 || (space == "Linear" && floats);
        software = spec.get_string_attribute("Software");
        focalLength = spec.get_int_attribute("Exif:FocalLengthIn35mmFilm", 0);
    }

    void read(std::span<uint8_t> samples) override { read(TypeDesc::UINT8, samples.data()); }
    void read(std::span<uint16_t> samples) override { read(TypeDesc::UINT16, samples.data()); }
    void read(std::span<float> samples) override { read(TypeDesc::FLOAT, samples.data()); }

private:
    void read(TypeDesc type, void* samples) {
        if (!input_->read_image(0, 0, 0, channels, type, samples))
            throwInput("{}: cannot be decoded: {}", name_, oneLine(input_->geterror()));
    }

    std::string name_;
    std::unique_ptr<IOProxy> proxy_;  // which input_ reads from
    ImageInput::unique_ptr input_;
};

class OiioCodecs : public PictureCodecs {
public:
    std::unique_ptr<PictureFile> open(const char* format, const std::string& name,
                                      std::span<const uint8_t> file) override {
        if (std::strcmp(format, "heif") == 0) return openHeif(name, file);
        std::unique_ptr<IOProxy> proxy;
        if (file.empty())
            proxy = std::make_unique<OIIO::Filesystem::IOFile>(name, IOProxy::Read);
        else
            proxy = std::make_unique<OIIO::Filesystem::IOMemReader>(file.data(), file.size());
        return std::make_unique<OiioFile>(format, name, std::move(proxy));
    }

    Image decodeJpeg(const std::string& name, std::span<const uint8_t> file, int channels,
                     int by) override {
        const std::unique_ptr<void, int (*)(void*)> decoder(tjInitDecompress(), tjDestroy);
        if (!decoder) throwMachine("{}: no memory is left to decode it", name);
        // What it warns of, OpenImageIO reads without a word.
        const auto require = [&](int result) {
            if (result == 0 || tjGetErrorCode(decoder.get()) == TJERR_WARNING) return;
            throwInput("{}: cannot be decoded: {}", name, oneLine(tjGetErrorStr2(decoder.get())));
        };
        int width = 0, height = 0, subsampling = 0, space = 0;
        require(tjDecompressHeader3(decoder.get(), file.data(), file.size(), &width, &height,
                                    &subsampling, &space));
        if (width < 1 || height < 1 || width > kMaxImageSide || height > kMaxImageSide)
            throwInput("{}: {} x {} pixels; expected at most {} a side", name, width, height,
                       kMaxImageSide);
        if (space != TJCS_YCbCr && space != TJCS_GRAY) return {};
        Image image;  // whose other constructor is the program's
        image.width = (width + by - 1) / by;
        image.height = (height + by - 1) / by;
        image.channels = channels;
        image.data.resize(image.rowBytes() * static_cast<size_t>(image.height));
        require(tjDecompress2(decoder.get(), file.data(), file.size(), image.data.data(),
                              image.width, 0, image.height, channels == 1 ? TJPF_GRAY : TJPF_RGB,
                              0));
        return image;
    }

    void convertToSrgb(Image& image, std::span<const uint8_t> profile) override {
        doppel::convertToSrgb(image, profile);
    }

    std::vector<uint8_t> encode(const Image& image, const char* format, const std::string& name,
                                const std::string& software) override {
        const ImageOutput::unique_ptr output = ImageOutput::create(format);
        if (!output) {
            OIIO::geterror();
            throwMachine("{}: this OpenImageIO cannot write {}", name, format);
        }
        ImageSpec spec(image.width, image.height, image.channels, TypeDesc::UINT8);
        spec.attribute("oiio:ColorSpace", "sRGB");
        if (image.channels == 2 || image.channels == 4) {
            spec.alpha_channel = image.channels - 1;
            spec.attribute("oiio:UnassociatedAlpha", 1);
        }
        if (std::strcmp(format, "jpeg") == 0) spec.attribute("Compression", "jpeg:95");
        if (std::strcmp(format, "png") == 0) spec.attribute("png:compressionLevel", kPngLevel);
        if (!software.empty()) spec.attribute("Software", software);
        OIIO::Filesystem::IOVecOutput proxy;
        if (!output->set_ioproxy(&proxy) || !output->open(name, spec) ||
            !output->write_image(TypeDesc::UINT8, image.data.data()) || !output->close()) {
            throwMachine("{}: cannot be encoded: {}", name, oneLine(output->geterror()));
        }
        return proxy.buffer();
    }
};

}  // namespace

}  // namespace doppel

extern "C" doppel::PictureCodecs* doppelPictures();
// Lives as long as the process.
doppel::PictureCodecs* doppelPictures() {
    static doppel::OiioCodecs codecs;
    return &codecs;
}
