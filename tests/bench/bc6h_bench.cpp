// SPDX-License-Identifier: Apache-2.0
// Quality and rate of encode_bc6h on panoramas.
//
//     ninja bc6h_bench && ./bc6h_bench ../testdata/panoramas/*
//
// usage: bc6h_bench [--threads N] [--crops N] FILE...
//
// Quality is 10 log10(16^2 / mean squared error) of log2(x + 1/1024) over all texels and channels: 16 octaves count as
// full scale; "mean" is by how much the mean of a channel is off at most.  Rates are in processor time, which other
// programs disturb less: Mtexel per second of one core, and what a cube of 1024 with its levels (8.39 Mtexel) takes on
// two.  --crops compares N crops of 64x64 texels, from the top of the picture to its bottom, with a search over all
// modes and partitions (tests/bc6h_exhaustive.h; a tenth of a second a block), and prints by how many dB they lose: the
// mean and the largest of them and of the squares of 16x16 texels that they consist of, and how many squares lose more
// than 0.5 dB.  bc6h_page.py makes BC6H.md of this.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <map>
#include <numeric>
#include <string>
#include <vector>

#include "../bc6h_exhaustive.h"
#include "bc6h.h"
#include "io.h"
#include "window_kernels.h"

namespace {

using namespace envconv;

constexpr struct {
  Bc6hEffort effort;
  const char* name;
} efforts[] = {{Bc6hEffort::fast, "fast"}, {Bc6hEffort::normal, "normal"}, {Bc6hEffort::best, "best"}};

double processor_seconds() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

double level(float x) { return std::log2(std::min(std::max(x, 0.f), 65504.f) + 1.0 / 1024); }
double decibels(double squared_error, double values) { return 10 * std::log10(256 * values / squared_error); }

std::size_t at(int i) { return static_cast<std::size_t>(i); }

struct Quality {
  std::vector<double> squared_errors;  // by block
  double mean_error = 0;               // of all texels' mean, relative, the largest among the channels
};

// Squared errors of blocks, and the error of the mean.
Quality quality(const Image& image, const std::vector<std::uint8_t>& blocks) {
  std::vector<float> rgb(image.pixel_count() * 3);
  decode_bc6h(blocks.data(), image.width(), image.height(), false, rgb.data());
  const int columns = (image.width() + 3) / 4;
  Quality q{std::vector<double>(blocks.size() / 16), 0};
  double given[3]{}, found[3]{};
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x)
      for (int c = 0; c < 3; ++c) {
        const float a = image.at(x, y)[c], b = rgb[3 * (at(y) * at(image.width()) + at(x)) + at(c)];
        given[c] += std::clamp(a, 0.f, 65504.f);
        found[c] += b;
        const double e = level(a) - level(b);
        q.squared_errors[at(y / 4 * columns + x / 4)] += e * e;
      }
  for (int c = 0; c < 3; ++c) q.mean_error = std::max(q.mean_error, std::abs(found[c] / given[c] - 1));
  return q;
}

constexpr int crop_size = 64, square_size = 16;

// Squared errors of the exhaustive search in some blocks.
struct Exhaustive {
  std::vector<std::array<int, 2>> crops;  // their first texels
  std::map<int, double> errors;           // by block
};
Exhaustive search_crops(const Image& image, int count) {
  Exhaustive found;
  const int columns = image.width() / 4;
  for (int i = 0; i < count; ++i) {
    const double across = std::fmod(i * 0.618034, 1), down = i / std::max(1.0, count - 1.0);
    const auto place = [](double share, int size) { return static_cast<int>(share * (size - crop_size)) / 4 * 4; };
    found.crops.push_back({place(across, image.width()), place(down, image.height())});
    for (int k = 0; k < crop_size * crop_size / 16; ++k) {
      const int column = found.crops.back()[0] / 4 + k % (crop_size / 4);
      const int row = found.crops.back()[1] / 4 + k / (crop_size / 4);
      test::HalfTexels texels;
      for (int t = 0; t < 16; ++t)
        for (int c = 0; c < 3; ++c)
          texels[at(t)][at(c)] = test::half_bits(image.at(4 * column + t % 4, 4 * row + t / 4)[c]);
      double& error = found.errors[row * columns + column];
      if (error == 0) error = test::ExhaustiveSearch(texels).error();
    }
  }
  return found;
}

// Losses, in dB, of the crops' squares of so many texels; of those where there is an error.
std::vector<double> losses(const Exhaustive& exhaustive, const Quality& q, int columns, int size) {
  std::vector<double> all;
  for (const auto& [left, top] : exhaustive.crops)
    for (int y = top; y < top + crop_size; y += size)
      for (int x = left; x < left + crop_size; x += size) {
        double error = 0, least = 0;
        for (int row = y / 4; row < (y + size) / 4; ++row)
          for (int column = x / 4; column < (x + size) / 4; ++column) {
            error += q.squared_errors[at(row * columns + column)];
            least += exhaustive.errors.at(row * columns + column);
          }
        if (least > 0) all.push_back(10 * std::log10(error / least));
      }
  return all;
}

void print(const Image& image, int threads, int crops) {
  const double values = 3.0 * static_cast<double>(image.pixel_count());
  const Exhaustive exhaustive = search_crops(image, crops);
  for (const auto& [effort, name] : efforts) {
    std::vector<std::uint8_t> blocks(bc6h_bytes(image.width(), image.height()));
    const double start = processor_seconds();
    encode_bc6h(image, effort, threads, blocks.data());
    const double seconds = processor_seconds() - start;
    const Quality q = quality(image, blocks);
    std::printf("  %-6s %6.2f dB  mean %5.2f %%  %6.2f Mtexel/s  cube %6.2f s", name,
                decibels(std::accumulate(q.squared_errors.begin(), q.squared_errors.end(), 0.0), values),
                100 * q.mean_error, values / 3e6 / seconds, seconds * 8.39e6 / (values / 3) / 2);
    for (const int size : {crop_size, square_size}) {
      const std::vector<double> lost = losses(exhaustive, q, image.width() / 4, size);
      if (lost.empty()) continue;
      std::printf("  loss of %d: mean %.2f dB, most %.2f dB, %d of %zu over 0.5 dB", size,
                  std::accumulate(lost.begin(), lost.end(), 0.0) / static_cast<double>(lost.size()),
                  *std::max_element(lost.begin(), lost.end()),
                  static_cast<int>(std::count_if(lost.begin(), lost.end(), [](double x) { return x > 0.5; })),
                  lost.size());
    }
    std::printf("\n");
  }
}

}  // namespace

int main(int argc, char** argv) {
  int threads = 1, crops = 0;
  std::vector<std::string> files;
  for (int i = 1; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--threads") && i + 1 < argc)
      threads = std::atoi(argv[++i]);
    else if (!std::strcmp(argv[i], "--crops") && i + 1 < argc)
      crops = std::max(0, std::atoi(argv[++i]));
    else
      files.emplace_back(argv[i]);
  }
  if (files.empty()) return std::fprintf(stderr, "usage: bc6h_bench [--threads N] [--crops N] FILE...\n"), 2;
  std::printf("SIMD %s\n", simd_target());
  for (const std::string& file : files) {
    const Result<PictureFile> pictures = read_pictures(file, {});
    if (!pictures || pictures->pictures[0].channels.count() < 3) {
      std::fprintf(stderr, "%s\n", pictures ? "not in colour" : pictures.error().message.c_str());
      continue;
    }
    std::printf("%s\n", file.c_str());
    print(pictures->pictures[0].image, threads, crops);
  }
}
