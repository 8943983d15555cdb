// SPDX-License-Identifier: Apache-2.0
#include "jpeg_read.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <new>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "embedded_metadata.h"
#include "exif.h"
#include "file_bytes.h"
#include "jpeg_source.h"

namespace envconv {
namespace {

using namespace std::string_view_literals;

constexpr int exif_and_xmp = JPEG_APP0 + 1, icc = JPEG_APP0 + 2, iptc = JPEG_APP0 + 13;

// These leave by longjmp, and return false then.

bool read_header(JpegInput& input, int fd, std::uint64_t size) {
  if (setjmp(input.messages.back)) return false;
  create_jpeg(input, fd, size);
  for (const int marker : {exif_and_xmp, icc, iptc, JPEG_COM}) jpeg_save_markers(&input.jpeg, marker, 0xFFFF);
  jpeg_read_header(&input.jpeg, TRUE);
  return true;
}

// The profile is the caller's to free, or null.
bool read_profile(JpegInput& input, JOCTET** profile, unsigned* size) {
  if (setjmp(input.messages.back)) return false;
  jpeg_read_icc_profile(&input.jpeg, profile, size);
  return true;
}

bool start(JpegInput& input) {
  if (setjmp(input.messages.back)) return false;
  jpeg_start_decompress(&input.jpeg);
  return quantisers_make_sense(input);
}

bool read_rows(JpegInput& input, JSAMPLE* to, int count) {
  if (setjmp(input.messages.back)) return false;
  const std::size_t row = std::size_t{input.jpeg.output_width} * static_cast<std::size_t>(input.jpeg.output_components);
  for (int i = 0; i < count; ++i, to += row) jpeg_read_scanlines(&input.jpeg, &to, 1);
  if (input.jpeg.output_scanline == input.jpeg.output_height) jpeg_finish_decompress(&input.jpeg);
  return true;
}

class JpegDecoder final : public Decoder {
 public:
  JpegDecoder() : input_(std::make_unique<JpegInput>()) {}  // zeros
  ~JpegDecoder() override { jpeg_destroy_decompress(&input_->jpeg); }
  JpegDecoder(const JpegDecoder&) = delete;
  JpegDecoder& operator=(const JpegDecoder&) = delete;

  /// False for a file that is left to the image library.
  Result<bool> open(int fd, const DecoderOptions& options) {
    ENVCONV_TRY(const std::uint64_t size, size_of_file(fd));
    if (!read_header(*input_, fd, size)) return failure();
    const jpeg_decompress_struct& jpeg = input_->jpeg;
    const bool grey = jpeg.num_components == 1 && jpeg.jpeg_color_space == JCS_GRAYSCALE;
    const bool color =
        jpeg.num_components == 3 && (jpeg.jpeg_color_space == JCS_YCbCr || jpeg.jpeg_color_space == JCS_RGB);
    if ((!grey && !color) || jpeg.data_precision != 8) return false;
    if (std::int64_t{jpeg.image_width} >
        options.max_pixels / std::max(std::int64_t{jpeg.image_height}, std::int64_t{1}))
      return too_many_pixels(jpeg.image_width, jpeg.image_height, options.max_pixels);
    PictureSpec picture;
    picture.width = static_cast<int>(jpeg.image_width);  // at most 65535, as the height
    picture.height = static_cast<int>(jpeg.image_height);
    picture.channels = Channels::standard(jpeg.num_components);
    picture.type = picture.element = PixelType::uint8;
    picture.band = band_rows(picture, 1);
    spec_.pictures.push_back(std::move(picture));
    spec_.transfer = Transfer::srgb;
    return take_metadata();
  }

  const FileSpec& spec() const override { return spec_; }

  Result<Ok> decode(int picture, void* pixels) override {
    return decode_rows(picture, 0, spec_.pictures.front().height, pixels);
  }

  Result<Ok> decode_rows(int, int first, int count, void* pixels) override {
    if (first == 0 && !start(*input_)) return failure();
    if (!read_rows(*input_, static_cast<JSAMPLE*>(pixels), count)) return failure();
    return Ok{};
  }

 private:
  Error failure() const {
    if (input_->messages.manager.msg_code == JERR_OUT_OF_MEMORY) throw std::bad_alloc();
    return damaged_file(input_->damage());
  }

  // False where there is more in it than is understood here.
  bool take_metadata() {
    std::optional<std::string> description;  // the first
    bool exif = false;
    for (const jpeg_marker_struct* m = input_->jpeg.marker_list; m; m = m->next) {
      const std::string_view bytes(reinterpret_cast<const char*>(m->data), m->data_length);
      constexpr auto exif_head = "Exif\0\0"sv;
      if (m->marker == exif_and_xmp && bytes.starts_with(exif_head)) {
        const auto fields = read_exif({m->data + exif_head.size(), m->data_length - exif_head.size()});
        if (!fields || std::exchange(exif, true)) return false;
        spec_.orientation = std::clamp(fields->orientation.value_or(1), 1, 8);
        if (fields->color_space) spec_.color_how = "the file's own";
        if (!description) description = fields->title;
      } else if (m->marker == exif_and_xmp && bytes.starts_with("http://ns.adobe.com/xap/1.0/\0"sv)) {
        if (!is_idle_xmp(bytes.substr("http://ns.adobe.com/xap/1.0/\0"sv.size()))) return false;
      } else if (m->marker == iptc) {
        if (bytes.find("envconv:") != bytes.npos) return false;
      } else if (m->marker == JPEG_COM && !description) {
        description = std::string(bytes);
      }
    }
    spec_.metadata["ImageDescription"] = own_description(description.value_or(""));
    return take_profile();
  }

  bool take_profile() {
    JOCTET* data = nullptr;
    unsigned size = 0;
    const bool whole = read_profile(*input_, &data, &size);
    const std::unique_ptr<JOCTET, void (*)(void*)> profile(data, std::free);
    return whole && (!profile || take_icc_profile({profile.get(), size}, PixelType::uint8, spec_));
  }

  std::unique_ptr<JpegInput> input_;
  FileSpec spec_;
};

}  // namespace

Result<std::unique_ptr<Decoder>> open_jpeg(int fd, const DecoderOptions& options) {
  auto decoder = std::make_unique<JpegDecoder>();
  ENVCONV_TRY(const bool ours, decoder->open(fd, options));
  return ours ? std::unique_ptr<Decoder>(std::move(decoder)) : std::unique_ptr<Decoder>();
}

}  // namespace envconv
