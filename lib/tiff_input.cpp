// SPDX-License-Identifier: Apache-2.0
#include "tiff_input.h"

#include <algorithm>
#include <cstdio>
#include <cstring>

#include "file_bytes.h"

namespace envconv {

namespace {

int hear_warning(TIFF*, void* to, const char* module, const char* format, va_list arguments) {
  auto& heard = *static_cast<TiffHeard*>(to);
  if (std::strncmp(format, "Bogus ", 6) == 0) heard.guessed = true;
  char text[256];
  std::vsnprintf(text, sizeof text, format, arguments);
  if (std::strcmp(module ? module : "", "JPEGLib") == 0 &&
      (std::strncmp(text, "Corrupt", 7) == 0 || std::strncmp(text, "Premature", 9) == 0))
    heard.corrupt = true;
  return 1;
}

}  // namespace

TiffInput::TiffInput(int fd, std::uint64_t size) : bytes_{fd, size, 0}, tiff_(nullptr, TIFFClose) {
  const auto options = tiff_messages_to(heard_.error);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), hear_warning, &heard_);
  tiff_.reset(TIFFClientOpenExt(
      "the file", "rm", &bytes_, read, [](thandle_t, void*, tmsize_t) { return tmsize_t{-1}; }, seek,
      [](thandle_t) { return 0; }, [](thandle_t handle) { return toff_t{static_cast<Bytes*>(handle)->size}; }, nullptr,
      nullptr, options.get()));
}

Error TiffInput::damage() const { return damaged_file(heard_.error.empty() ? "libtiff gave no reason" : heard_.error); }

tmsize_t TiffInput::read(thandle_t handle, void* to, tmsize_t count) {
  auto& bytes = *static_cast<Bytes*>(handle);
  const std::uint64_t there = bytes.size - std::min(bytes.position, bytes.size);
  const std::uint64_t n = std::min(there, static_cast<std::uint64_t>(std::max<tmsize_t>(count, 0)));
  if (!read_at(bytes.fd, bytes.position, {static_cast<std::uint8_t*>(to), static_cast<std::size_t>(n)})) return -1;
  bytes.position += n;
  return static_cast<tmsize_t>(n);
}

toff_t TiffInput::seek(thandle_t handle, toff_t offset, int whence) {
  auto& bytes = *static_cast<Bytes*>(handle);
  bytes.position = (whence == SEEK_CUR ? bytes.position : whence == SEEK_END ? bytes.size : 0) + offset;
  return bytes.position;
}

}  // namespace envconv
