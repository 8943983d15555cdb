// SPDX-License-Identifier: Apache-2.0
// libjpeg reading an open file, as strict as it can be: what it warns of is an error.  It is left by longjmp, so that
// nothing with a destructor may live in a function that calls it.  Internal: not installed.
#pragma once

#include <cstddef>
#include <cstdio>
// These need std::size_t and FILE.
#include <jerror.h>
#include <jpeglib.h>

#include <array>
#include <csetjmp>
#include <cstdint>

namespace envconv {

/// A file, and what libjpeg knows of it; plain data, which stays where it is.
struct JpegInput {
  /// What libjpeg reads from.  The members that are its own come first, so that pointers to them are pointers to all.
  struct Source {
    jpeg_source_mgr manager;
    int fd;
    std::uint64_t size, position;
    bool unreadable;
    std::array<JOCTET, 65536> buffer;
  };
  struct Messages {
    jpeg_error_mgr manager;
    std::jmp_buf back;  ///< set by whoever calls libjpeg: where it goes with an error or a warning
    std::array<char, JMSG_LENGTH_MAX> text;
  };
  Source source;
  Messages messages;
  jpeg_decompress_struct jpeg;

  /// Why libjpeg went back.
  const char* damage() const { return source.unreadable ? "cannot be read" : messages.text.data(); }
};

/// Makes the decompressor, on an input of zeros, for a file of that size; with `back` set.
void create_jpeg(JpegInput& input, int fd, std::uint64_t size);

/// Steps are 1 or more (ITU-T T.81, B.2.4.1); of 0, nothing would be left: false then, which is the damage.  Once
/// decompression has started.
bool quantisers_make_sense(JpegInput& input);

}  // namespace envconv
