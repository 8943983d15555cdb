// SPDX-License-Identifier: Apache-2.0
#include "tiff_predictor.h"

#include <algorithm>
#include <cstring>

namespace envconv {
namespace {

template <class T>
void add_up(std::span<std::uint8_t> line, std::size_t channels) {
  // A line is a row of a buffer, whose elements need not be aligned to T.
  const std::size_t count = line.size() / sizeof(T);
  const auto at = [&](std::size_t i) { return line.data() + i * sizeof(T); };
  for (std::size_t i = channels; i < count; ++i) {
    T before, value;
    std::memcpy(&before, at(i - channels), sizeof before);
    std::memcpy(&value, at(i), sizeof value);
    value = static_cast<T>(value + before);
    std::memcpy(at(i), &value, sizeof value);
  }
}

// Three sums at a time, which need not wait for each other.
void add_up_triples(std::span<std::uint8_t> line) {
  std::uint8_t a = 0, b = 0, c = 0;
  std::size_t i = 0;
  for (; i + 3 <= line.size(); i += 3) {
    line[i] = a = static_cast<std::uint8_t>(a + line[i]);
    line[i + 1] = b = static_cast<std::uint8_t>(b + line[i + 1]);
    line[i + 2] = c = static_cast<std::uint8_t>(c + line[i + 2]);
  }
  if (i < line.size()) line[i] = static_cast<std::uint8_t>(a + line[i]);
  if (i + 1 < line.size()) line[i + 1] = static_cast<std::uint8_t>(b + line[i + 1]);
}

void add_up_bytes(std::span<std::uint8_t> line, std::size_t channels) {
  if (channels == 3) return add_up_triples(line);
  add_up<std::uint8_t>(line, channels);
}

// Planes of the samples' bytes, the highest first.
template <std::size_t size>
void join_planes(const std::uint8_t* planes, std::size_t count, std::uint8_t* to) {
  for (std::size_t i = 0; i < count; ++i)
    for (std::size_t byte = 0; byte < size; ++byte) to[i * size + size - 1 - byte] = planes[byte * count + i];
}

void swap_bytes(std::span<std::uint8_t> line, std::size_t size) {
  for (std::size_t i = 0; i + size <= line.size(); i += size) std::reverse(&line[i], &line[i] + size);
}

}  // namespace

void undo_tiff_predictor(const TiffSamples& samples, std::span<std::uint8_t> line, std::vector<std::uint8_t>& buffer) {
  constexpr int differences = 2, floating_point = 3;
  if (samples.predictor == floating_point) {
    add_up_bytes(line, samples.channels);
    buffer.assign(line.begin(), line.end());
    const std::size_t count = line.size() / samples.size;
    if (samples.size == 2) return join_planes<2>(buffer.data(), count, line.data());
    return join_planes<4>(buffer.data(), count, line.data());
  }
  if (samples.swapped && samples.size > 1) swap_bytes(line, samples.size);
  if (samples.predictor != differences) return;
  if (samples.size == 1) return add_up_bytes(line, samples.channels);
  if (samples.size == 2) return add_up<std::uint16_t>(line, samples.channels);
  add_up<std::uint32_t>(line, samples.channels);
}

}  // namespace envconv
