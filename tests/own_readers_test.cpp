// SPDX-License-Identifier: Apache-2.0
// Files that are read here as well as by the image library: both say the same of them, and deliver the same elements.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <string>
#include <vector>
// These need std::size_t and FILE.
#include <jpeglib.h>
#include <tiffio.h>

#include <cstdio>

#include "decoder.h"
#include "isolated_messages.h"
#include "temporary_folder.h"

namespace envconv {
namespace {

using namespace std::string_literals;

// --- numbers in files ------------------------------------------------------------------------------------------------

std::string number(std::uint32_t value, int bytes, bool little) {
  std::string text;
  for (int i = 0; i < bytes; ++i) text += static_cast<char>(value >> 8 * (little ? i : bytes - 1 - i) & 255);
  return text;
}
std::string big(std::uint32_t value, int bytes = 4) { return number(value, bytes, false); }

// ICC.1:2022: a matrix profile of that gamma, primaries not far from sRGB's.
std::string matrix_profile(double gamma, const std::string& kind = "RGB ") {
  const auto xyz = [](double x, double y, double z) {
    std::string text = "XYZ " + big(0);
    for (const double v : {x, y, z}) text += big(static_cast<std::uint32_t>(v * 65536));
    return text;
  };
  const std::string curve = "curv" + big(0) + big(1) + big(static_cast<std::uint32_t>(gamma * 256), 2) + "\0\0"s;
  const std::string name = "desc" + big(0) + big(5) + "test\0"s + std::string(4 + 4 + 2 + 1 + 67 + 2, '\0');
  const std::pair<std::string, std::string> tags[] = {
      {"desc", name},  {"wtpt", xyz(0.9642, 1, 0.8249)},      {"rXYZ", xyz(0.4361, 0.2225, 0.0139)},
      {"rTRC", curve}, {"gXYZ", xyz(0.3851, 0.7169, 0.0971)}, {"gTRC", curve},
      {"bTRC", curve}, {"bXYZ", xyz(0.1431, 0.0606, 0.7141)}};
  std::string table = big(std::size(tags)), data;
  const auto start = static_cast<std::uint32_t>(128 + 4 + 12 * std::size(tags));
  for (const auto& [tag, value] : tags) {
    table += tag + big(start + static_cast<std::uint32_t>(data.size())) + big(static_cast<std::uint32_t>(value.size()));
    data += value;
    data.resize((data.size() + 3) / 4 * 4);
  }
  std::string head(128, '\0');
  head.replace(8, 4, big(0x02400000)).replace(12, 12, "mntr" + kind + "XYZ ").replace(36, 4, "acsp");
  head.replace(68, 12, big(0xF6D6) + big(0x10000) + big(0xD32D));
  std::string whole = head + table + data;
  return whole.replace(0, 4, big(static_cast<std::uint32_t>(whole.size())));
}

struct Field {
  int tag, type;
  std::string value;  // in the file's order
};

// An Exif block of two directories; where the second one is empty there is none.
std::string exif(bool little, std::vector<Field> first, const std::vector<Field>& second) {
  const auto n = [little](std::size_t value, int bytes) {
    return number(static_cast<std::uint32_t>(value), bytes, little);
  };
  constexpr int sizes[] = {0, 1, 1, 2, 4, 8, 1, 1};
  std::string more;
  const auto directory = [&](const std::vector<Field>& fields, std::size_t more_at) {
    std::string text = n(fields.size(), 2);
    for (const Field& f : fields) {
      text += n(static_cast<std::size_t>(f.tag), 2) + n(static_cast<std::size_t>(f.type), 2);
      text += n(f.value.size() / static_cast<std::size_t>(sizes[f.type]), 4);
      text += f.value.size() > 4 ? n(more_at + more.size(), 4) : (f.value + std::string(4, '\0')).substr(0, 4);
      if (f.value.size() > 4) more += f.value;
    }
    return text + n(0, 4);
  };
  const auto size_of = [](std::size_t fields) { return 2 + 12 * fields + 4; };
  if (!second.empty()) first.push_back({0x8769, 4, n(8 + size_of(first.size() + 1), 4)});
  const std::size_t more_at = 8 + size_of(first.size()) + (second.empty() ? 0 : size_of(second.size()));
  std::string text = (little ? "II*\0"s : "MM\0*"s) + n(8, 4) + directory(first, more_at);
  if (!second.empty()) text += directory(second, more_at);
  return "Exif\0\0"s + text + more;
}

// --- what both readers say -------------------------------------------------------------------------------------------

class OwnReaders : public testing::Test, protected TemporaryFolder {
 protected:
  static void SetUpTestSuite() { ::setenv("ENVCONV_MODULE_PATH", ENVCONV_BUILD, 0); }

  struct Told {
    bool opened = false, ours = false, decoded = false;
    std::string spec, pixels, error;
  };

  static Told read(const std::string& file, const std::string& format, bool library, int level = 0) {
    const int fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
    EXPECT_GE(fd, 0);
    Told told;
    auto decoder = open_decoder(format, fd, {.max_pixels = 1 << 24, .threads = 2, .level = level, .library = library});
    told.opened = decoder.ok();
    told.ours = told.opened && *decoder;
    if (!told.opened) told.error = decoder.error().message;
    if (told.ours) {
      FileSpec spec = (*decoder)->spec();
      const PictureSpec& p = spec.pictures.front();
      told.pixels.assign(bytes_of_rows(p, p.height), '\0');
      told.decoded = true;
      const int band = rows_at_a_time(p);
      for (int y = 0; y < p.height && told.decoded; y += band) {
        const auto done =
            (*decoder)->decode_rows(0, y, std::min(band, p.height - y), told.pixels.data() + bytes_of_rows(p, y));
        told.decoded = done.ok();
        if (!done) told.error = done.error().message;
      }
      for (PictureSpec& picture : spec.pictures) picture.band = 0;
      told.spec = pack(spec);
    }
    ::close(fd);
    return told;
  }

  // The reader here takes the file, or leaves it to the library as `ours` says; and does not differ from it.
  void check(const std::string& what, const std::string& bytes, const std::string& format, bool ours = true,
             int level = 0) {
    SCOPED_TRACE(what);
    put("file", bytes);
    const Told here = read(path("file"), format, false, level), there = read(path("file"), format, true, level);
    ASSERT_TRUE(there.opened && there.decoded);
    ASSERT_TRUE(here.opened);
    EXPECT_EQ(here.ours, ours);
    if (!here.ours) return;
    EXPECT_TRUE(here.decoded);
    EXPECT_EQ(here.spec, there.spec);
    EXPECT_TRUE(here.pixels == there.pixels);
  }
};

// --- JPEG ------------------------------------------------------------------------------------------------------------

struct JpegKind {
  const char* name;
  J_COLOR_SPACE from, to;
  bool ours = true;
  int horizontal = 1, vertical = 1;  // how much denser the first component is sampled
  bool progressive = false, arithmetic = false;
  unsigned restart = 0;
};

int components_of(J_COLOR_SPACE space) {
  return space == JCS_GRAYSCALE ? 1 : space == JCS_CMYK || space == JCS_YCCK ? 4 : 3;
}

std::string jpeg_of(const JpegKind& kind, int width, int height) {
  jpeg_error_mgr errors;
  jpeg_compress_struct jpeg;
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  unsigned char* data = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&jpeg, &data, &size);
  jpeg.image_width = static_cast<JDIMENSION>(width), jpeg.image_height = static_cast<JDIMENSION>(height);
  jpeg.in_color_space = kind.from;
  jpeg.input_components = components_of(kind.from);
  jpeg_set_defaults(&jpeg);
  jpeg_set_colorspace(&jpeg, kind.to);
  jpeg.comp_info[0].h_samp_factor = kind.horizontal, jpeg.comp_info[0].v_samp_factor = kind.vertical;
  jpeg.arith_code = kind.arithmetic;
  jpeg.restart_interval = kind.restart;
  if (kind.progressive) jpeg_simple_progression(&jpeg);
  jpeg_start_compress(&jpeg, TRUE);
  std::vector<JSAMPLE> row(static_cast<std::size_t>(width * jpeg.input_components));
  for (int y = 0; y < height; ++y) {
    for (std::size_t i = 0; i < row.size(); ++i)
      row[i] = static_cast<JSAMPLE>(128 + 90 * std::sin(0.02 * static_cast<double>(i) + 0.1 * y) + y % 7 * 3);
    JSAMPROW at = row.data();
    jpeg_write_scanlines(&jpeg, &at, 1);
  }
  jpeg_finish_compress(&jpeg);
  std::string bytes(reinterpret_cast<const char*>(data), size);
  jpeg_destroy_compress(&jpeg);
  std::free(data);
  return bytes;
}

const JpegKind jpeg_kinds[] = {
    {"grey", JCS_GRAYSCALE, JCS_GRAYSCALE},
    {"4:4:4", JCS_RGB, JCS_YCbCr},
    {"4:2:0", JCS_RGB, JCS_YCbCr, true, 2, 2},
    {"4:2:2", JCS_RGB, JCS_YCbCr, true, 2, 1},
    {"4:4:0", JCS_RGB, JCS_YCbCr, true, 1, 2},
    {"RGB", JCS_RGB, JCS_RGB},
    {"progressive", JCS_RGB, JCS_YCbCr, true, 2, 2, true},
    {"arithmetic", JCS_RGB, JCS_YCbCr, true, 2, 2, false, true},
    {"restarts", JCS_RGB, JCS_YCbCr, true, 2, 2, false, false, 3},
    {"CMYK", JCS_CMYK, JCS_CMYK, false},
    {"YCCK", JCS_CMYK, JCS_YCCK, false},
};

TEST_F(OwnReaders, JpegOfEveryKind) {
  for (const JpegKind& kind : jpeg_kinds) {
    check(kind.name, jpeg_of(kind, 123, 61), "jpeg", kind.ours);
    check(kind.name + ", in bands"s, jpeg_of(kind, 1501, 1203), "jpeg", kind.ours);
  }
}

// A marker's segment behind the start of the file.
std::string with_segment(const std::string& jpeg, int marker, const std::string& bytes) {
  return jpeg.substr(0, 2) + "\xFF"s + static_cast<char>(marker) +
         big(static_cast<std::uint32_t>(bytes.size() + 2), 2) + bytes + jpeg.substr(2);
}

TEST_F(OwnReaders, JpegMetadata) {
  const std::string plain = jpeg_of(jpeg_kinds[1], 40, 20), ours = "envconv:layout=latlong envconv:frame=world";
  const auto exif_of = [&](bool little, const std::vector<Field>& first, const std::vector<Field>& second = {}) {
    return with_segment(plain, 0xE1, exif(little, first, second));
  };
  for (const bool little : {true, false}) {
    const auto word = [little](std::uint32_t value) { return number(value, 2, little); };
    for (std::uint32_t turn = 0; turn <= 9; ++turn)
      check("orientation " + std::to_string(turn), exif_of(little, {{0x112, 3, word(turn)}}), "jpeg");
    for (const std::uint32_t space : {1u, 2u, 0xFFFFu})
      check("space " + std::to_string(space), exif_of(little, {}, {{0xA001, 3, word(space)}}), "jpeg");
    check("description", exif_of(little, {{0x10E, 2, ours + "\0"s}, {0x112, 3, word(6)}}), "jpeg");
    check("short description", exif_of(little, {{0x10E, 2, "abc\0"s}}), "jpeg");
    check("other fields", exif_of(little, {{0x10F, 2, "maker\0"s}, {0x112, 3, word(3)}}, {{0x9000, 7, "0232"}}),
          "jpeg");
    check("a comment", exif_of(little, {{0x112, 3, word(3)}}, {{0x9286, 7, "ASCII\0\0\0hello"s}}), "jpeg");
    check("our comment", exif_of(little, {}, {{0x9286, 7, "ASCII\0\0\0"s + ours}}), "jpeg", false);
    check("orientation in four bytes", exif_of(little, {{0x112, 4, number(6, 4, little)}}), "jpeg", false);
    check("orientation where it does not belong", exif_of(little, {}, {{0x112, 3, word(6)}}), "jpeg", false);
    check("twice", exif_of(little, {{0x112, 3, word(6)}, {0x112, 3, word(3)}}), "jpeg", false);
  }
  const std::string described = exif(true, {{0x10E, 2, "a picture\0"s}}, {});
  check("comment", with_segment(plain, 0xFE, ours), "jpeg");
  check("comment with a zero", with_segment(plain, 0xFE, ours + "\0more"s), "jpeg");
  check("long comment", with_segment(plain, 0xFE, ours + std::string(9000, 'x')), "jpeg");
  check("two comments", with_segment(with_segment(plain, 0xFE, ours), 0xFE, "another"), "jpeg");
  check("comment behind Exif", with_segment(with_segment(plain, 0xFE, ours), 0xE1, described), "jpeg");
  check("Exif behind a comment", with_segment(with_segment(plain, 0xE1, described), 0xFE, ours), "jpeg");
  check("two Exif blocks", with_segment(with_segment(plain, 0xE1, described), 0xE1, described), "jpeg", false);
  check("IPTC", with_segment(plain, 0xED, "Photoshop 3.0\0"s + "8BIM" + big(1028, 2) + std::string(6, '\0')), "jpeg");
  check("ours in IPTC",
        with_segment(plain, 0xED,
                     "Photoshop 3.0\0"s + "8BIM" + big(1028, 2) + std::string(4, '\0') + big(50, 2) + "\x1C\x02\x78"s +
                         big(45, 2) + ours),
        "jpeg", false);
  const auto xmp = [&](const std::string& attribute) {
    return with_segment(plain, 0xE1,
                        "http://ns.adobe.com/xap/1.0/\0"s +
                            "<x:xmpmeta xmlns:x='adobe:ns:meta/'><rdf:RDF "
                            "xmlns:rdf='http://www.w3.org/1999/02/22-rdf-syntax-ns#'><rdf:Description "
                            "xmlns:tiff='http://ns.adobe.com/tiff/1.0/' "
                            "xmlns:GPano='http://ns.google.com/photos/1.0/panorama/' " +
                            attribute + "/></rdf:RDF></x:xmpmeta>");
  };
  check("XMP of a panorama", xmp("GPano:ProjectionType='equirectangular' GPano:PoseHeadingDegrees='12'"), "jpeg");
  check("XMP that turns it", xmp("tiff:Orientation='6'"), "jpeg", false);
}

TEST_F(OwnReaders, JpegProfiles) {
  const std::string plain = jpeg_of(jpeg_kinds[1], 40, 20);
  const auto segment = [](const std::string& jpeg, int i, int n, const std::string& part) {
    return with_segment(jpeg, 0xE2, "ICC_PROFILE\0"s + static_cast<char>(i) + static_cast<char>(n) + part);
  };
  for (const double gamma : {1.0, 1.8, 2.2}) check("gamma", segment(plain, 1, 1, matrix_profile(gamma)), "jpeg");
  const std::string profile = matrix_profile(2.2), first = profile.substr(0, 200), second = profile.substr(200);
  check("in two parts", segment(segment(plain, 2, 2, second), 1, 2, first), "jpeg");
  check("in the other order", segment(segment(plain, 1, 2, first), 2, 2, second), "jpeg");
  check("a part is missing", segment(plain, 1, 2, first), "jpeg", false);
  check("two of one number", segment(segment(plain, 1, 2, first), 1, 2, second), "jpeg", false);
  check("of a printer", segment(plain, 1, 1, matrix_profile(2.2, "CMYK")), "jpeg", false);
}

// What is cut off, or changed in the scan, is an error of both or of the reader here alone.
TEST_F(OwnReaders, JpegDamage) {
  for (const JpegKind& kind : jpeg_kinds) {
    if (!kind.ours) continue;
    SCOPED_TRACE(kind.name);
    const std::string whole = jpeg_of(kind, 123, 61);
    int refused = 0;
    const auto check_damaged = [&](const std::string& bytes) {
      put("file", bytes);
      const Told here = read(path("file"), "jpeg", false), there = read(path("file"), "jpeg", true);
      if (here.opened && !here.ours) return;
      refused += !here.decoded;
      // Before the end mark a few bytes may be left over, for which the library refuses progressive files alone.
      const bool left_over = there.error.find("1 extraneous bytes before marker 0xd9") != there.error.npos;
      EXPECT_EQ(here.decoded, there.decoded || (kind.progressive && left_over)) << there.error;
      if (here.decoded && there.decoded) {
        EXPECT_TRUE(here.pixels == there.pixels);
      }
    };
    for (std::size_t i = 1; i < 20; ++i) check_damaged(whole.substr(0, whole.size() * i / 20));
    for (std::size_t at = 20; at < whole.size(); at += 37) {
      std::string flipped = whole;
      flipped[at] = static_cast<char>(flipped[at] ^ 1 << at % 8);
      check_damaged(flipped);
    }
    EXPECT_GE(refused, 19);
  }
}

// --- TIFF ------------------------------------------------------------------------------------------------------------

struct TiffKind {
  const char* name;
  int bits = 8, format = SAMPLEFORMAT_UINT, channels = 3;
  int compression = COMPRESSION_NONE, predictor = PREDICTOR_NONE;
  bool ours = true;
  const char* order = "l";  // of bytes: "l" or "b"; "8" for BigTIFF
  int rows = 0;             // of a strip; 0: as libtiff has them
  int tile = 0;
  int photometric = PHOTOMETRIC_RGB, planar = PLANARCONFIG_CONTIG, fill = FILLORDER_MSB2LSB;
  std::vector<std::uint16_t> extra = {};
};

// Noise over waves, in the bits of any type; floating point is finite.
std::vector<std::uint8_t> samples_of(const TiffKind& kind, std::size_t count) {
  std::vector<std::uint8_t> bytes;
  std::uint32_t state = 7;
  for (std::size_t i = 0; i < count; ++i) {
    state = state * 1664525 + 1013904223;
    const float wave = 0.5f + 0.4f * std::sin(0.01f * static_cast<float>(i)) + static_cast<float>(state >> 24) * 1e-4f;
    std::uint32_t value = static_cast<std::uint32_t>(wave * 40000) >> (kind.bits == 8 ? 8 : 0);
    if (kind.format == SAMPLEFORMAT_IEEEFP && kind.bits == 32) std::memcpy(&value, &wave, sizeof value);
    if (kind.format == SAMPLEFORMAT_IEEEFP && kind.bits == 16) value = (state >> 16 & 0x83FF) | 0x3800 | (i % 5 << 10);
    for (int b = 0; b < kind.bits / 8; ++b) bytes.push_back(static_cast<std::uint8_t>(b < 4 ? value >> 8 * b : 0));
  }
  return bytes;
}

void write_directory(TIFF* tiff, const TiffKind& kind, int width, int height,
                     const std::function<void(TIFF*)>& more = {}) {
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, width);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, height);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, kind.channels);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, kind.bits);
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, kind.format);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, kind.photometric);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, kind.planar);
  TIFFSetField(tiff, TIFFTAG_FILLORDER, kind.fill);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, kind.compression);
  if (kind.predictor != PREDICTOR_NONE) TIFFSetField(tiff, TIFFTAG_PREDICTOR, kind.predictor);
  if (!kind.extra.empty())
    TIFFSetField(tiff, TIFFTAG_EXTRASAMPLES, static_cast<int>(kind.extra.size()), kind.extra.data());
  if (kind.tile > 0) {
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, kind.tile);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, kind.tile);
  } else {
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP,
                 kind.rows > 0 ? kind.rows : static_cast<int>(TIFFDefaultStripSize(tiff, 0)));
  }
  if (more) more(tiff);
  const int planes = kind.planar == PLANARCONFIG_SEPARATE ? kind.channels : 1;
  const auto line = static_cast<std::size_t>(TIFFScanlineSize(tiff));
  if (kind.tile > 0) {
    const auto size = static_cast<std::size_t>(TIFFTileSize(tiff));
    auto bytes = samples_of(kind, size / static_cast<std::size_t>(kind.bits / 8));
    for (std::uint32_t t = 0; t < TIFFNumberOfTiles(tiff); ++t)
      ASSERT_GT(TIFFWriteEncodedTile(tiff, t, bytes.data(), static_cast<tmsize_t>(size)), 0);
  } else {
    auto bytes = samples_of(kind, line * static_cast<std::size_t>(height) / static_cast<std::size_t>(kind.bits / 8));
    for (int p = 0; p < planes; ++p)
      for (int y = 0; y < height; ++y) {
        std::vector<std::uint8_t> row(bytes.begin() + static_cast<std::ptrdiff_t>(line) * y,
                                      bytes.begin() + static_cast<std::ptrdiff_t>(line) * (y + 1));
        ASSERT_EQ(TIFFWriteScanline(tiff, row.data(), static_cast<std::uint32_t>(y), static_cast<std::uint16_t>(p)), 1);
      }
  }
  ASSERT_EQ(TIFFWriteDirectory(tiff), 1);
}

const std::vector<TiffKind> tiff_kinds = [] {
  std::vector<TiffKind> kinds;
  struct Sample {
    int bits, format;
  };
  for (const auto& [bits, format] : {Sample{8, SAMPLEFORMAT_UINT}, Sample{16, SAMPLEFORMAT_UINT},
                                     Sample{16, SAMPLEFORMAT_IEEEFP}, Sample{32, SAMPLEFORMAT_IEEEFP}})
    for (const int compression : {COMPRESSION_NONE, COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE, COMPRESSION_DEFLATE})
      for (const int predictor : {PREDICTOR_NONE, PREDICTOR_HORIZONTAL, PREDICTOR_FLOATINGPOINT}) {
        const bool real = format == SAMPLEFORMAT_IEEEFP;
        if (predictor != PREDICTOR_NONE && compression == COMPRESSION_NONE) continue;
        if (predictor == PREDICTOR_FLOATINGPOINT && !real) continue;
        TiffKind kind{
            .name = "basic", .bits = bits, .format = format, .compression = compression, .predictor = predictor};
        for (kind.order = "l"; kind.order; kind.order = *kind.order == 'l'   ? "b"
                                                        : *kind.order == 'b' ? "l8"
                                                                             : nullptr) {
          kind.channels = 3, kind.photometric = PHOTOMETRIC_RGB, kind.rows = 7, kind.tile = 0;
          kinds.push_back(kind);
          kind.channels = 1, kind.photometric = PHOTOMETRIC_MINISBLACK, kind.rows = 0, kind.tile = 32;
          kinds.push_back(kind);
          if (std::strlen(kind.order) > 1) break;
        }
      }
  return kinds;
}();

class TiffReaders : public OwnReaders {
 protected:
  std::string tiff_of(const TiffKind& kind, int width, int height, const std::function<void(TIFF*)>& more = {}) {
    TIFF* tiff = TIFFOpen(path("written").c_str(), ("w"s + kind.order).c_str());
    write_directory(tiff, kind, width, height, more);
    TIFFClose(tiff);
    return bytes_of("written");
  }
};

TEST_F(TiffReaders, TiffOfEveryKind) {
  for (const TiffKind& kind : tiff_kinds) {
    const std::string name = std::to_string(kind.bits) + " bits, compression " + std::to_string(kind.compression) +
                             ", predictor " + std::to_string(kind.predictor) + ", " + kind.order;
    check(name, tiff_of(kind, 101, 45), "tiff");
  }
  TiffKind large{
      .name = "large", .compression = COMPRESSION_ADOBE_DEFLATE, .predictor = PREDICTOR_HORIZONTAL, .rows = 50};
  check("in bands", tiff_of(large, 1501, 1203), "tiff");
  large.tile = 128;
  check("in bands of tiles", tiff_of(large, 1501, 1203), "tiff");
  large.tile = 0, large.rows = 5000;
  check("one strip", tiff_of(large, 1501, 1203), "tiff");
}

TEST_F(TiffReaders, TiffChannels) {
  constexpr std::uint16_t any = EXTRASAMPLE_UNSPECIFIED, alpha = EXTRASAMPLE_ASSOCALPHA, apart = EXTRASAMPLE_UNASSALPHA;
  const std::vector<std::uint16_t> extras[] = {{},           {any},        {alpha},          {apart},
                                               {any, alpha}, {apart, any}, {any, any, alpha}};
  for (const bool grey : {false, true})
    for (const auto& extra : extras) {
      TiffKind kind{.name = "extra",
                    .channels = (grey ? 1 : 3) + static_cast<int>(extra.size()),
                    .photometric = grey ? PHOTOMETRIC_MINISBLACK : PHOTOMETRIC_RGB,
                    .extra = extra};
      check((grey ? "grey and " : "RGB and "s) + std::to_string(extra.size()) + " " +
                std::to_string(extra.empty() ? 0 : extra[0]),
            tiff_of(kind, 40, 20), "tiff");
    }
}

TEST_F(TiffReaders, TiffOfOtherKinds) {
  const TiffKind kinds[] = {
      {.name = "planes", .ours = false, .planar = PLANARCONFIG_SEPARATE},
      {.name = "white is zero", .channels = 1, .ours = false, .photometric = PHOTOMETRIC_MINISWHITE},
      {.name = "bits from the right", .ours = false, .fill = FILLORDER_LSB2MSB},
      {.name = "signed", .format = SAMPLEFORMAT_INT, .ours = false},
      {.name = "32 bits", .bits = 32, .ours = false},
      {.name = "64 bits", .bits = 64, .format = SAMPLEFORMAT_IEEEFP, .ours = false},
      {.name = "CMYK", .channels = 4, .ours = false, .photometric = PHOTOMETRIC_SEPARATED},
      {.name = "PackBits", .compression = COMPRESSION_PACKBITS, .ours = false},
      {.name = "JPEG", .compression = COMPRESSION_JPEG, .ours = false},
  };
  for (const TiffKind& kind : kinds) check(kind.name, tiff_of(kind, 48, 32), "tiff", kind.ours);
}

TEST_F(TiffReaders, TiffMetadata) {
  const TiffKind plain{.name = "plain"};
  const auto with = [&](const std::function<void(TIFF*)>& more) { return tiff_of(plain, 40, 20, more); };
  const auto text = [&](std::uint32_t tag, const std::string& value) {
    return with([tag, value](TIFF* tiff) { TIFFSetField(tiff, tag, value.c_str()); });
  };
  const auto block = [&](std::uint32_t tag, const std::string& value) {
    return with([tag, value](TIFF* tiff) { TIFFSetField(tiff, tag, static_cast<int>(value.size()), value.data()); });
  };
  for (int turn = 1; turn <= 8; ++turn)
    check("orientation " + std::to_string(turn),
          with([turn](TIFF* tiff) { TIFFSetField(tiff, TIFFTAG_ORIENTATION, turn); }), "tiff");
  const std::string ours = "envconv:layout=latlong envconv:frame=world";
  check("ours", text(TIFFTAG_IMAGEDESCRIPTION, ours), "tiff");
  check("long", text(TIFFTAG_IMAGEDESCRIPTION, ours + std::string(9000, 'x')), "tiff");
  check("another", text(TIFFTAG_IMAGEDESCRIPTION, "a picture"), "tiff");
  check("artist", text(TIFFTAG_ARTIST, ours), "tiff");
  for (const double gamma : {1.0, 2.2}) check("profile", block(TIFFTAG_ICCPROFILE, matrix_profile(gamma)), "tiff");
  check("profile of a printer", block(TIFFTAG_ICCPROFILE, matrix_profile(2.2, "CMYK")), "tiff", false);
  check("XMP of a panorama", block(TIFFTAG_XMLPACKET, "<x:xmpmeta xmlns:x='adobe:ns:meta/'/>"), "tiff");
  check("XMP that turns it", block(TIFFTAG_XMLPACKET, "<x:xmpmeta xmlns:x='adobe:ns:meta/' tiff:Orientation='6'/>"),
        "tiff", false);
  check("IPTC", with([](TIFF* tiff) { TIFFSetField(tiff, TIFFTAG_RICHTIFFIPTC, 2, "\x1C\x02\x05\0\3abc"); }), "tiff",
        false);
  check("where it lies", with([](TIFF* tiff) {
          TIFFSetField(tiff, TIFFTAG_XPOSITION, 3.0f), TIFFSetField(tiff, TIFFTAG_XRESOLUTION, 1.0f);
        }),
        "tiff");
}

TEST_F(TiffReaders, TiffOfSeveralPictures) {
  for (const bool levels : {false, true}) {
    TIFF* tiff = TIFFOpen(path("written").c_str(), "w");
    for (int k = 0; k < 4; ++k)
      write_directory(tiff, {.name = "level", .compression = COMPRESSION_LZW, .tile = levels ? 16 : 0}, 64 >> k,
                      32 >> k, [levels](TIFF* t) {
                        if (levels) TIFFSetField(t, TIFFTAG_PIXAR_TEXTUREFORMAT, "Plain Texture");
                      });
    TIFFClose(tiff);
    const std::string bytes = bytes_of("written");
    for (int k = 0; k < (levels ? 4 : 1); ++k) check("level " + std::to_string(k), bytes, "tiff", true, k);
  }
}

// As TIFF has no checksums but Deflate's, what is damaged may decode: to the library's pixels then, or the library
// refuses it as well.
TEST_F(TiffReaders, TiffDamage) {
  for (const int compression : {COMPRESSION_NONE, COMPRESSION_LZW, COMPRESSION_ADOBE_DEFLATE}) {
    SCOPED_TRACE(compression);
    const TiffKind kind{.name = "damaged", .compression = compression, .rows = 8};
    const std::string whole = tiff_of(kind, 60, 30);
    int refused = 0;
    const auto check_damaged = [&](const std::string& bytes) {
      put("file", bytes);
      const Told here = read(path("file"), "tiff", false), there = read(path("file"), "tiff", true);
      if (here.opened && !here.ours) return;
      refused += !here.decoded;
      EXPECT_EQ(here.decoded, there.decoded) << here.error << "; " << there.error;
      if (here.decoded && there.decoded) {
        EXPECT_TRUE(here.pixels == there.pixels);
      }
    };
    for (std::size_t i = 1; i < 20; ++i) check_damaged(whole.substr(0, whole.size() * i / 20));
    for (std::size_t at = 4; at<whole.size(); at += at + 400> whole.size() ? 1 : 13) {
      std::string flipped = whole;
      flipped[at] = static_cast<char>(flipped[at] ^ 1 << at % 8);
      check_damaged(flipped);
    }
    EXPECT_GE(refused, 19);
  }
}

}  // namespace
}  // namespace envconv
