// SPDX-License-Identifier: Apache-2.0
// Files: pictures in, pictures out, whole or not at all.  EXR goes through OpenEXR; Radiance, DDS, KTX and KTX2 through
// our own code; everything else through the image library's module, which is loaded only when a file needs it.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "color_encoding.h"
#include "image.h"
#include "result.h"

namespace envconv {

/// Stored type of a channel, or, from r11g11b10f on, of a whole texel in the containers that engines load: unsigned
/// floats of 11, 11 and 10 bits; three 9-bit mantissas that share an exponent; blocks of 4x4 texels in 16 bytes (BC6H,
/// unsigned).
enum class PixelType { half, float32, uint8, uint16, uint32, r11g11b10f, rgb9e5, bc6h };
std::string_view name_of(PixelType type);  ///< "half", "float", "uint8" ... "r11g11b10f", "rgb9e5", "bc6h"

/// String attributes by name, "envconv:layout" and the like, and the "envmap" of EXR ("latlong", "cube", or when read
/// "unknown N" for a kind that OpenEXR does not define).
using Metadata = std::map<std::string, std::string>;

/// One picture of a file: the only one, an EXR part, a face or layer of a DDS, KTX or KTX2 file, or a face's file.
struct Picture {
  std::string name;  ///< part name, or ""
  Image image;       ///< linear, alpha associated
  Channels channels;
  PixelType type = PixelType::float32;  ///< as stored (the first channel's)
};

/// A file as it was read.
struct PictureFile {
  std::string path;
  std::string format;             ///< "openexr", "hdr", "png", "dds", "ktx2" ...
  std::string compression;        ///< the format's name for it, or ""
  std::string color;              ///< the curve that values were stored along: "linear", "sRGB", "gamma 2.2" ...
  ColorEncoding color_encoding;   ///< the same for programs, and the primaries where the file tells them
  std::string color_how;          ///< how that is known: "chromaticities", "gAMA", "integers are taken for sRGB" ...
  bool as_stored = false;         ///< no curve was taken off: asked for, or values of a space recorded by name
  int levels = 1;                 ///< MIP levels in the file
  std::vector<Picture> pictures;  ///< of the level asked for
  Metadata metadata;
  std::vector<std::string> warnings;  ///< one line each: overscan cropped, channels left out ...
  int level = 0;                      ///< the one that was read
};

/// How to read.
struct ReadOptions {
  std::int64_t max_pixels = std::int64_t{1} << 30;  ///< refuse inputs that claim more
  bool trust_input = false;                         ///< decode in this process, without isolation
  bool header_only = false;                         ///< pixels are not decoded: images have a size and no pixels
  int threads = 0;                                  ///< decoding threads; 0: all cores
  int level = 0;                                    ///< of a file with levels; one that it lacks is an input error
  bool as_stored = false;                           ///< whatever the file says, no curve is taken off
  /// The alpha channel is left out, and colour is as stored: that of EXR is what lies over black, and that of PNG,
  /// which keeps colour apart from alpha, is not multiplied by it.
  bool drop_alpha = false;
  /// Where large pictures are kept instead of in memory; nullptr: in memory.  Looked at after `accept`, which may be
  /// what sets it.
  std::shared_ptr<Scratch> scratch{};
  /// Asked, once the header is known and before there is memory for pixels, whether to go on; its error is the
  /// result.  It may take its time.  The images have a size and no pixels.  Not asked with header_only.
  std::function<Result<Ok>(const PictureFile& header)> accept{};
};

/// Reads one file; errors are ErrorCode::input (or limit), and name the path, what is wrong and what to do.
/// Recognises the format by its first bytes, never by the name alone; EXR tiles and scan lines, all parts of one file
/// whose parts are faces; Y, YA, RGB, RGBA and arbitrary channel sets of up to 64 channels.  Integer files are sRGB
/// unless they say otherwise; orientation (Exif, Radiance) and Radiance's exposure are applied.  Any thread may call
/// it.
Result<PictureFile> read_pictures(const std::string& path, const ReadOptions& options);

/// Starts the process in which untrusted files are decoded.  Call it before threads are made (the tool does, first
/// thing); without it, the first isolated read starts it.  It costs nothing until a file needs the image library.
void start_isolated_reader();

/// What integers hold.
enum class Encoding {
  srgb,  ///< colour along sRGB's curve: the writer applies it
  as_is  ///< the values as they are given: data, or colour that was encoded already
};

/// How to write.
struct WriteOptions {
  PixelType type = PixelType::half;
  bool type_given = false;  ///< false: the nearest that the format has
  std::string compression;  ///< "" for the format's usual; "zip", "piz", "dwaa:45", "jpeg quality" as the format has
  Metadata metadata;
  Encoding encoding = Encoding::srgb;
  /// What the values mean, for the fields that formats have for it: chromaticities in EXR of RGB in linear light, cICP,
  /// sRGB, gAMA and cHRM in PNG, PRIMARIES in Radiance, and envconv:colorspace (its `space`) where there is metadata.
  /// With Encoding::srgb, integers are sRGB whatever this says.
  ColorEncoding color;
  bool cube = false;  ///< the pictures of a level are the six faces of a cube, +x -x +y -y +z -z
  int threads = 0;
  bool verify = false;  ///< read back and compare before the file takes its name
  /// Asked, once the file is whole, whether it may take its name; an error removes it and is the result.
  std::function<Result<Ok>()> before_commit{};
};

/// What happened to values that the format cannot hold.
struct WriteReport {
  PixelType type = PixelType::half;   ///< as written
  std::int64_t clamped_high = 0;      ///< values above the type's largest (65504 for half)
  std::int64_t clamped_negative = 0;  ///< negative values in a format without sign
  std::int64_t nonfinite = 0;         ///< NaN or infinite values replaced
  std::vector<std::string> warnings;
};

/// True when the path's extension is that of a file which keeps faces of one size apart by itself, as the faces of a
/// cube or the layers of an array: dds, ktx, ktx2.
bool holds_faces(const std::string& path);

/// True when the path's extension names a format that can be written, with so many pictures (EXR parts; faces or layers
/// of DDS and KTX) and MIP levels: the reason otherwise.
Result<Ok> can_write(const std::string& path, const WriteOptions& options, int parts, int channels, int levels = 1);

/// Writes pictures (more than one: EXR parts, or faces or layers of DDS, KTX and KTX2) to a temporary name in the same
/// folder, syncs and renames: a reader never sees half a file, and a failure leaves the old content and nothing else.
/// Integer formats hold what WriteOptions::encoding makes of the pixels.  Errors: output, unsupported.
Result<WriteReport> write_pictures(const std::string& path, const std::vector<Picture>& pictures,
                                   const WriteOptions& options);

/// The same with MIP levels, level 0 first: every level has the same pictures in the same order, and sizes halve,
/// rounded down, to at least 1.
Result<WriteReport> write_levels(const std::string& path, std::span<const std::vector<Picture>> levels,
                                 const WriteOptions& options);

}  // namespace envconv
