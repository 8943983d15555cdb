// SPDX-License-Identifier: Apache-2.0
// What reading and writing OpenEXR share.  Internal: not installed.
#pragma once

#include <ImfCompression.h>

#include <cctype>
#include <exception>
#include <string>

namespace envconv {

/// What OpenEXR calls a stream in its messages.
inline constexpr char kStreamName[] = "the file";

// OpenEXR's messages begin with what it was doing, to which file, and end with the reason.
inline std::string exr_reason(const std::exception& error) {
  std::string text = error.what();
  const std::string name = std::string("\"") + kStreamName + "\". ";
  const std::size_t at = text.rfind(name);
  if (at != std::string::npos) text = text.substr(at + name.size());
  while (!text.empty() && (text.back() == '.' || text.back() == '\n' || text.back() == ' ')) text.pop_back();
  if (!text.empty()) text[0] = static_cast<char>(std::tolower(static_cast<unsigned char>(text[0])));
  return text;
}

/// Compressions by their names on the command line.
struct CompressionName {
  const char* name;
  Imf::Compression value;
};
inline constexpr CompressionName kCompressions[] = {
    {"none", Imf::NO_COMPRESSION},   {"rle", Imf::RLE_COMPRESSION},   {"zip", Imf::ZIP_COMPRESSION},
    {"zips", Imf::ZIPS_COMPRESSION}, {"piz", Imf::PIZ_COMPRESSION},   {"pxr24", Imf::PXR24_COMPRESSION},
    {"b44", Imf::B44_COMPRESSION},   {"b44a", Imf::B44A_COMPRESSION}, {"dwaa", Imf::DWAA_COMPRESSION},
    {"dwab", Imf::DWAB_COMPRESSION},
};

}  // namespace envconv
