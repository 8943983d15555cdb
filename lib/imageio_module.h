// SPDX-License-Identifier: Apache-2.0
// The boundary to the image library's module: plain data and functions, so that neither side needs the other's C++
// library, and nothing is thrown across.  Internal: not installed.
#pragma once

#include <cstddef>
#include <cstdint>

extern "C" {

/// Changes when anything below does.
constexpr std::uint32_t kEnvconvImageioAbi = 6;

/// A picture that was opened.  Numbers of types are envconv::PixelType's, of transfers envconv::Transfer's.
struct EnvconvImageioSpec {
  std::int64_t width, height;
  std::int32_t channels, alpha;  // alpha: an index or -1
  std::int32_t type;             // as stored
  std::int32_t element;          // as delivered
  std::int32_t transfer;
  float gamma;
  std::int32_t unassociated, orientation, levels, pictures;
  std::int32_t transfer_told;  // by the file: 0 when it was assumed
  char compression[32];
  char profile[128];         // description of an ICC profile, or ""
  const void* profile_data;  // the profile, as long as the picture is open
  std::size_t profile_size;  // bytes; 0 where there is none
  char names[64][32];        // of the channels; unused ones are empty
  char description[4096];    // ours, "envconv:layout=cube envconv:...", or ""
};

/// A picture to write: [height][width][channels] elements, top row first.
struct EnvconvImageioPicture {
  std::int64_t width, height;
  std::int32_t channels, alpha;
  std::int32_t element;
  const char* const* names;
  const void* pixels;
  const char* compression;  // the library's own text, or ""
  const char* description;  // one line, or ""
  const char* curve;        // the library's word for it, or ""
  const char* attribute;    // the attribute that the description goes into
};

/// Where bytes go.  None of these may fail: errors are remembered behind them.
struct EnvconvImageioSink {
  void* context;
  void (*write)(void* context, const void* data, std::size_t size);
  std::size_t (*read)(void* context, void* data, std::size_t size);
  void (*seek)(void* context, std::uint64_t position);
  std::uint64_t (*tell)(void* context);
  std::uint64_t (*size)(void* context);
};

/// What the module exports as `envconv_imageio`.  Functions return 1, or 0 and a text in `error`.
struct EnvconvImageio {
  std::uint32_t abi;
  const char* version;  // of the image library
  /// Makes the library's tables, which costs time once: a process that is forked afterwards has them already.  Makes no
  /// thread, which would not be in that process.
  void (*prepare)();
  /// Reads an open file, whose descriptor must outlive the handle, of a format named as the image library does.  -1:
  /// the file may be good, and cannot be read for the reason in `error`.
  /// `level`: the MIP level that the spec and read() speak of; the last where there are fewer.
  int (*open)(const char* format, int fd, int level, EnvconvImageioSpec* spec, void** handle, char* error,
              std::size_t error_size);
  /// `bytes` is the size of `pixels` and must be what the spec needs.
  int (*read)(void* handle, void* pixels, std::size_t bytes, char* error, std::size_t error_size);
  void (*close)(void* handle);
  int (*write)(const char* format, const EnvconvImageioPicture* picture, const EnvconvImageioSink* sink, char* error,
               std::size_t error_size);
};

}  // extern "C"
