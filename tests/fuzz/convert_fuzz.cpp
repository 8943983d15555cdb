// SPDX-License-Identifier: Apache-2.0
// Reads, resamples and writes: the last eight bytes of the input say how, the rest is a file.  Formats that other
// people's libraries read are left to those people.
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <string>

#include "filter.h"
#include "io.h"
#include "packing.h"
#include "recognize.h"
#include "resample.h"

namespace envconv {
namespace {

template <class T>
const T& chosen(std::span<const T> all, std::uint8_t byte) {
  return all[byte % all.size()];
}

constexpr int largest_output = 24;  // texels: small, so that many inputs are tried

void convert(const std::string& input, const std::string& output, const std::uint8_t* how) {
  ReadOptions read;
  read.max_pixels = 1 << 12;
  read.trust_input = true;
  read.threads = 1;
  read.drop_alpha = how[0] & 1;
  Result<PictureFile> file = read_pictures(input, read);
  if (!file) return;
  InputHints hints;
  if (how[0] & 2) hints.layout = &chosen(all_layouts(), how[1]);
  if (how[0] & 4) hints.frame = &chosen(all_frames(), how[2]);
  const Result<Recognition> what = recognize(*file, hints);
  if (!what) return;
  const Result<EnvImage> source = to_environment(std::move(*file), *what);
  if (!source) return;
  ResampleOptions options;
  options.layout = &chosen(all_layouts(), how[3]);
  options.height = 1 + how[4] % largest_output;
  options.placement = options.layout->info().placement;
  options.filter = &chosen(all_filters(), how[5]);
  options.rotation.yaw = how[6];
  options.threads = 1;
  Result<EnvImage> result = resample(*source, options);
  if (!result) return;
  const Channels channels = result->channels;
  Result<Image> packed = pack(*options.layout, default_packing(*options.layout), std::move(result->faces));
  if (!packed) return;
  std::vector<Picture> pictures;
  pictures.push_back({"", std::move(*packed), channels, PixelType::float32});
  WriteOptions write;
  write.threads = 1;
  write.verify = how[0] & 8;
  constexpr std::array<const char*, 3> extensions{".exr", ".hdr", ".pfm"};
  (void)write_pictures(output + extensions[how[7] % extensions.size()], pictures, write);
}

}  // namespace
}  // namespace envconv

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::size_t tail = 8;
  // The image library is not what is tried here: without its module, what it would read is refused.
  static const bool alone = ::setenv("ENVCONV_MODULE_PATH", "/nonexistent", 1) == 0;
  static const int fd = alone ? ::memfd_create("fuzz", MFD_CLOEXEC) : -1;
  static const std::string input = "/proc/self/fd/" + std::to_string(fd);
  static const std::string output = "/tmp/envconv-fuzz-" + std::to_string(::getpid());
  if (size <= tail || std::memcmp(data, "\x76\x2f\x31\x01", 4) == 0) return 0;
  if (fd < 0 || ::ftruncate(fd, 0) != 0 || ::pwrite(fd, data, size - tail, 0) != static_cast<ssize_t>(size - tail)) {
    std::abort();
  }
  envconv::convert(input, output, data + size - tail);
  for (const char* extension : {".exr", ".hdr", ".pfm"}) ::unlink((output + extension).c_str());
  return 0;
}
