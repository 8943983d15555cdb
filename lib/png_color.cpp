// SPDX-License-Identifier: Apache-2.0
#include "png_color.h"

#include <libdeflate.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <string_view>

namespace envconv {
namespace {

// ITU-T H.273, TransferCharacteristics.
constexpr int kRec709Curve = 1, kGamma22Curve = 4, kLinearCurve = 8, kSrgbCurve = 13, kPqCurve = 16, kHlgCurve = 18;
constexpr double kUnit = 100000;  // of gAMA and cHRM

std::uint32_t number(const unsigned char* p) {
  return std::uint32_t{p[0]} << 24 | std::uint32_t{p[1]} << 16 | std::uint32_t{p[2]} << 8 | p[3];
}

void read_cicp(const unsigned char* data, PngColor& color) {
  color.how = "cICP";
  for (const Primaries& primaries : all_primaries()) {
    if (primaries.cicp == data[0]) color.primaries = primaries.xy;
  }
  switch (data[1]) {
    case kRec709Curve:
    case 6:
    case 14:
    case 15:
      color.transfer = Transfer::gamma;
      color.gamma = 2.4;  // as a display shows it (Rec. 1886)
      break;
    case kGamma22Curve: color.transfer = Transfer::gamma, color.gamma = 2.2; break;
    case 5: color.transfer = Transfer::gamma, color.gamma = 2.8; break;
    case kLinearCurve: color.transfer = Transfer::linear; break;
    case kSrgbCurve: color.transfer = Transfer::srgb; break;
    case kPqCurve: color.note = "the PQ curve"; break;
    case kHlgCurve: color.note = "the HLG curve"; break;
    default: color.note = "curve " + std::to_string(data[1]);
  }
}

}  // namespace

std::optional<PngColor> read_png_color(int fd) {
  PngColor cicp, srgb, gamma;
  std::optional<Chromaticities> chromaticities;
  off_t at = 8;
  for (int chunks = 0; chunks < 1000; ++chunks) {
    std::array<unsigned char, 40> bytes{};
    const ssize_t got = ::pread(fd, bytes.data(), bytes.size(), at);
    if (got < 12) break;
    const std::uint32_t size = number(bytes.data());
    const std::string_view type(reinterpret_cast<const char*>(bytes.data()) + 4, 4);
    const unsigned char* data = bytes.data() + 8;
    if (type == "IDAT" || type == "IEND" || size > 0x7FFFFFFF) break;
    const bool whole = got >= static_cast<ssize_t>(std::min<std::uint32_t>(size, 32)) + 8;
    if (whole && type == "cICP" && size == 4) {
      read_cicp(data, cicp);
    } else if (whole && type == "sRGB" && size == 1) {
      srgb.how = "sRGB";
      srgb.transfer = Transfer::srgb;
      srgb.primaries = rec709();
    } else if (whole && type == "gAMA" && size == 4 && number(data) > 0) {
      gamma.how = "gAMA";
      gamma.gamma = kUnit / number(data);
      // A file's gamma of 1/2.2 stands for sRGB more often than not, but so it was said.
      gamma.transfer = number(data) == kUnit ? Transfer::linear : Transfer::gamma;
      if (!(gamma.gamma > 0.01 && gamma.gamma < 100)) gamma = {};
    } else if (whole && type == "cHRM" && size == 32) {
      const auto xy = [&](int i) { return number(data + 4 * i) / kUnit; };
      chromaticities = usable_primaries({xy(2), xy(3), xy(4), xy(5), xy(6), xy(7), xy(0), xy(1)});
    }
    at += static_cast<off_t>(size) + 12;
  }
  if (!cicp.how.empty()) return cicp;
  if (!srgb.how.empty()) return srgb;
  if (gamma.how.empty()) return {};
  gamma.primaries = chromaticities;
  return gamma;
}

std::string big_endian(std::uint32_t value) {
  std::string bytes;
  for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift & 0xFF);
  return bytes;
}

std::string png_chunk(std::string_view type, std::string_view data) {
  std::string bytes = big_endian(static_cast<std::uint32_t>(data.size()));
  bytes.append(type).append(data);
  return bytes + big_endian(libdeflate_crc32(0, bytes.data() + 4, bytes.size() - 4));
}

std::string png_color_chunks(const ColorEncoding& encoding) {
  if (encoding.transfer == Transfer::unknown) return {};
  const Chromaticities xy = encoding.primaries.value_or(rec709());
  const Primaries* primaries = find_primaries(xy);
  int curve = 0;
  double gamma = encoding.transfer == Transfer::gamma ? encoding.gamma : 1;
  if (encoding.transfer == Transfer::linear) curve = kLinearCurve;
  if (encoding.transfer == Transfer::srgb) curve = kSrgbCurve, gamma = 2.2;
  if (encoding.transfer == Transfer::gamma && gamma == 2.2) curve = kGamma22Curve;
  if (encoding.transfer == Transfer::gamma && gamma == 2.4) curve = kRec709Curve;
  std::string chunks;
  if (primaries && primaries->cicp > 0 && curve > 0) {
    // Primaries, curve, RGB itself, full range.
    chunks += png_chunk("cICP", std::string{static_cast<char>(primaries->cicp), static_cast<char>(curve), 0, 1});
  }
  if (encoding.transfer == Transfer::srgb && primaries && primaries->name == "rec709") {
    chunks += png_chunk("sRGB", std::string(1, '\0'));  // perceptual intent
  }
  chunks += png_chunk("gAMA", big_endian(static_cast<std::uint32_t>(std::lround(kUnit / gamma))));
  const std::array<double, 8> values = chromaticity_values(xy);
  // Unsigned: a primary beyond the plane's edge cannot be told.
  if (*std::min_element(values.begin(), values.end()) < 0) return chunks;
  std::string data;
  for (const std::size_t i : {6, 7, 0, 1, 2, 3, 4, 5}) {
    data += big_endian(static_cast<std::uint32_t>(std::lround(values[i] * kUnit)));
  }
  return chunks + png_chunk("cHRM", data);
}

}  // namespace envconv
