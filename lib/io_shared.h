// SPDX-License-Identifier: Apache-2.0
// What reading and writing files share.  Internal: not installed.
#pragma once

#include <exception>
#include <memory>
#include <new>
#include <string>

#include "io.h"
#include "output_file.h"

namespace envconv {

/// The error with its file's name in front.
Error on(const std::string& path, Error error);
Error on(const std::string& path, ErrorCode code, const std::string& what);

/// In lower case, without the dot; "" when there is none.
std::string extension_of(const std::string& path);
/// Threads to use when so many were asked for; 0: one per core.
int thread_count(int asked);
bool is_integer(PixelType type);

/// What values of a type mean in a file that is written so: sRGB where the writer puts integers along that curve, else
/// what the options say.
ColorEncoding stored_color(const WriteOptions& options, PixelType type);

/// Our attributes in one line "envconv:layout=cube envconv:...", for formats that have a description and nothing else.
std::string join_metadata(const Metadata& metadata);
void split_metadata(const std::string& line, Metadata& metadata);

/// IEC 61966-2-1; values beyond [0, 1] go on along the same formula.
double srgb_to_linear(double v);
double linear_to_srgb(double v);

struct FreeBytes {
  void operator()(void* p) const;
};

/// Pixels as integers, uint8 or uint16: [height][width][channels], rounded, colour apart from alpha.  What does not fit
/// is clamped and counted.
std::unique_ptr<void, FreeBytes> to_elements(const Picture& picture, PixelType type, Encoding encoding,
                                             WriteReport& report);

/// As read_pictures(), which is this with exceptions caught.
Result<PictureFile> read_file(const std::string& path, const ReadOptions& options);

// The interface throws nothing: what a library below throws becomes an error.
template <class T, class F>
Result<T> guarded(const std::string& path, ErrorCode code, F&& f) {
  try {
    return f();
  } catch (const std::bad_alloc&) {
    return on(path, ErrorCode::limit, "not enough memory");
  } catch (const std::exception& error) {
    return on(path, code, error.what());
  } catch (...) {
    return on(path, code, "unknown failure");
  }
}

}  // namespace envconv
