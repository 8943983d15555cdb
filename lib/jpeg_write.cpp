// SPDX-License-Identifier: Apache-2.0
#include "jpeg_write.h"

#include <csetjmp>
#include <cstdio>
// These need std::size_t and FILE.
#include <jerror.h>
#include <jpeglib.h>

#include <algorithm>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include "stored_pixels.h"

namespace envconv {
namespace {

constexpr std::size_t most_in_marker = 65533;  // bytes

// --- Exif ----------------------------------------------------------------------------------------------------------

void put16(std::string& to, std::uint32_t v) { to += {static_cast<char>(v & 255), static_cast<char>(v >> 8 & 255)}; }
void put32(std::string& to, std::uint32_t v) {
  put16(to, v & 0xFFFF);
  put16(to, v >> 16);
}

// An entry of a directory whose value fits in four bytes, or is at an offset.
struct Entry {
  std::uint16_t tag, type;
  std::uint32_t count, value;
};

void put_directory(std::string& to, const std::vector<Entry>& entries) {
  put16(to, static_cast<std::uint32_t>(entries.size()));
  for (const Entry& entry : entries) {
    put16(to, entry.tag), put16(to, entry.type);
    put32(to, entry.count), put32(to, entry.value);
  }
  put32(to, 0);  // no other one
}

// What an APP1 marker holds (CIPA DC-008, Exif 2.32): a TIFF file, in little-endian order, of two directories.
std::string exif(const StoredPixels& pixels, const std::string& description, bool srgb) {
  enum : std::uint16_t { ascii = 2, word = 3, long_word = 4, undefined = 7 };
  const auto four = [](const char* text) {
    return static_cast<std::uint32_t>(text[0]) | static_cast<std::uint32_t>(text[1]) << 8 |
           static_cast<std::uint32_t>(text[2]) << 16 | static_cast<std::uint32_t>(text[3]) << 24;
  };
  const auto size_of_directory = [](std::size_t entries) { return static_cast<std::uint32_t>(2 + 12 * entries + 4); };
  const auto length = static_cast<std::uint32_t>(description.size() + 1);
  constexpr std::uint32_t first = 8;
  std::vector<Entry> image, picture;
  const std::uint32_t second = first + size_of_directory(description.empty() ? 1 : 2);
  picture.push_back({0x9000, undefined, 4, four("0232")});      // ExifVersion
  picture.push_back({0x9101, undefined, 4, four("\1\2\3\0")});  // ComponentsConfiguration: Y, Cb, Cr
  picture.push_back({0xA000, undefined, 4, four("0100")});      // FlashpixVersion
  if (srgb) picture.push_back({0xA001, word, 1, 1});            // ColorSpace
  picture.push_back({0xA002, long_word, 1, static_cast<std::uint32_t>(pixels.width)});   // PixelXDimension
  picture.push_back({0xA003, long_word, 1, static_cast<std::uint32_t>(pixels.height)});  // PixelYDimension
  if (!description.empty())
    image.push_back({0x010E, ascii, length, second + size_of_directory(picture.size())});  // ImageDescription
  image.push_back({0x8769, long_word, 1, second});                                         // of the other directory
  std::string bytes("Exif\0\0II*\0", 10);
  put32(bytes, first);
  put_directory(bytes, image);
  put_directory(bytes, picture);
  if (!description.empty()) bytes.append(description.c_str(), length);
  return bytes;
}

// --- libjpeg -------------------------------------------------------------------------------------------------------

struct Destination {
  jpeg_destination_mgr manager;  // the first, so that libjpeg's pointer is one to this
  OutputFile* file;
  JOCTET buffer[1 << 16];
};

struct Failure {
  jpeg_error_mgr manager;  // likewise
  std::jmp_buf leave;
  char message[JMSG_LENGTH_MAX];
};

void rewind_buffer(Destination& to) {
  to.manager.next_output_byte = to.buffer;
  to.manager.free_in_buffer = sizeof to.buffer;
}

void set_destination(jpeg_compress_struct& jpeg, Destination& to, OutputFile& file) {
  to.file = &file;
  to.manager.init_destination = [](j_compress_ptr j) { rewind_buffer(*reinterpret_cast<Destination*>(j->dest)); };
  to.manager.empty_output_buffer = [](j_compress_ptr j) -> boolean {
    Destination& d = *reinterpret_cast<Destination*>(j->dest);
    d.file->write(d.buffer, sizeof d.buffer);  // all of it, whatever the fields say
    rewind_buffer(d);
    return TRUE;
  };
  to.manager.term_destination = [](j_compress_ptr j) {
    Destination& d = *reinterpret_cast<Destination*>(j->dest);
    d.file->write(d.buffer, sizeof d.buffer - d.manager.free_in_buffer);
  };
  jpeg.dest = &to.manager;
}

void set_failure(jpeg_compress_struct& jpeg, Failure& failure) {
  jpeg.err = jpeg_std_error(&failure.manager);
  failure.manager.error_exit = [](j_common_ptr j) {
    Failure& f = *reinterpret_cast<Failure*>(j->err);
    f.manager.format_message(j, f.message);
    std::longjmp(f.leave, 1);
  };
  failure.manager.output_message = [](j_common_ptr) {};  // it would print
}

// False when libjpeg gave up.  No object with a destructor lives here: it leaves by longjmp.
bool encode(jpeg_compress_struct& jpeg, Failure& failure, Destination& destination, OutputFile& file,
            const StoredPixels& pixels, int quality, const std::string& exif_bytes, const std::string& comment) {
  if (setjmp(failure.leave) != 0) return false;
  jpeg_create_compress(&jpeg);
  set_destination(jpeg, destination, file);
  jpeg.image_width = static_cast<JDIMENSION>(pixels.width);
  jpeg.image_height = static_cast<JDIMENSION>(pixels.height);
  jpeg.input_components = pixels.channels;
  jpeg.in_color_space = pixels.channels == 1 ? JCS_GRAYSCALE : JCS_RGB;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, quality, TRUE);
  jpeg_start_compress(&jpeg, TRUE);
  const auto marker = [&](int number, const std::string& bytes) {
    jpeg_write_marker(&jpeg, number, reinterpret_cast<const JOCTET*>(bytes.data()),
                      static_cast<unsigned>(bytes.size()));
  };
  if (!exif_bytes.empty()) marker(JPEG_APP0 + 1, exif_bytes);
  if (!comment.empty()) marker(JPEG_COM, comment);
  for (int y = 0; y < pixels.height; ++y) {
    JSAMPROW row = const_cast<JSAMPROW>(pixels.row(y));  // only read
    jpeg_write_scanlines(&jpeg, &row, 1);
  }
  jpeg_finish_compress(&jpeg);
  return true;
}

}  // namespace

Result<Ok> write_jpeg(OutputFile& file, const Picture& picture, int quality, const WriteOptions& options,
                      WriteReport& report) {
  if (std::max(picture.image.width(), picture.image.height()) > JPEG_MAX_DIMENSION)
    return Error{ErrorCode::unsupported, "JPEG has at most " + std::to_string(JPEG_MAX_DIMENSION) + " texels a side"};
  const StoredPixels pixels = stored_pixels(picture, options, report);
  std::string description = join_metadata(options.metadata);
  std::string exif_bytes = exif(pixels, description, stored_color(options, report.type).transfer == Transfer::srgb);
  if (exif_bytes.size() > most_in_marker) {
    report.warnings.push_back("JPEG has no room for so much metadata: the layout is not recorded");
    description.clear(), exif_bytes.clear();
  }
  const auto destination = std::make_unique<Destination>();
  Failure failure{};
  jpeg_compress_struct jpeg{};
  set_failure(jpeg, failure);
  const bool done = encode(jpeg, failure, *destination, file, pixels, quality, exif_bytes, description);
  jpeg_destroy_compress(&jpeg);
  if (!done && failure.manager.msg_code == JERR_OUT_OF_MEMORY) throw std::bad_alloc();
  if (!done) return Error{ErrorCode::output, failure.message};
  return Ok{};
}

}  // namespace envconv
