// SPDX-License-Identifier: Apache-2.0
// Quality and rate of encode_bc6h on panoramas.
//
//     ninja bc6h_bench && ./bc6h_bench ../testdata/panoramas/*
//
// usage: bc6h_bench [--threads N] [--exhaustive STRIDE] FILE...
//
// Quality is 10 log10(16^2 / mean squared error) of log2(x + 1/1024) over all texels and channels: 16 octaves count as
// full scale; "mean" is by how much the mean of a channel is off at most.  Rates are in processor time, which other
// programs disturb less: Mtexel per second of one core, and what a cube of 1024 with its levels (8.39 Mtexel) takes on
// two.  --exhaustive compares every STRIDE-th block with a search over all modes and partitions
// (tests/bc6h_exhaustive.h; a tenth of a second a block): the loss in dB. bc6h_page.py makes BC6H.md of this.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <string>
#include <vector>

#include "../bc6h_exhaustive.h"
#include "bc6h.h"
#include "io.h"
#include "read_kernels.h"

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
  double squared_error = 0;  // over the chosen blocks
  double mean_error = 0;     // of all texels' mean, relative, the largest among the channels
};

// Of blocks whose number is a multiple of the stride.
Quality quality(const Image& image, const std::vector<std::uint8_t>& blocks, int stride) {
  std::vector<float> rgb(image.pixel_count() * 3);
  decode_bc6h(blocks.data(), image.width(), image.height(), false, rgb.data());
  Quality q;
  double given[3]{}, found[3]{};
  for (int y = 0; y < image.height(); ++y)
    for (int x = 0; x < image.width(); ++x)
      for (int c = 0; c < 3; ++c) {
        const float a = image.at(x, y)[c], b = rgb[3 * (at(y) * at(image.width()) + at(x)) + at(c)];
        given[c] += std::min(std::max(a, 0.f), 65504.f), found[c] += b;
        const double e = level(a) - level(b);
        if ((y / 4 * (image.width() / 4) + x / 4) % stride == 0) q.squared_error += e * e;
      }
  for (int c = 0; c < 3; ++c) q.mean_error = std::max(q.mean_error, std::abs(found[c] / given[c] - 1));
  return q;
}

double exhaustive_error(const Image& image, int stride) {
  const int columns = image.width() / 4;
  double sum = 0;
  for (int block = 0; block < columns * (image.height() / 4); block += stride) {
    test::HalfTexels texels;
    for (int k = 0; k < 16; ++k)
      for (int c = 0; c < 3; ++c)
        texels[at(k)][at(c)] =
            test::half_bits(image.at(4 * (block % columns) + k % 4, 4 * (block / columns) + k / 4)[c]);
    sum += test::ExhaustiveSearch(texels).error();
  }
  return sum;
}

void print(const Image& image, int threads, int stride) {
  const double values = 3.0 * static_cast<double>(image.pixel_count());
  const double least = stride ? exhaustive_error(image, stride) : 0;
  for (const auto& [effort, name] : efforts) {
    std::vector<std::uint8_t> blocks(bc6h_bytes(image.width(), image.height()));
    const double start = processor_seconds();
    encode_bc6h(image, effort, threads, blocks.data());
    const double seconds = processor_seconds() - start;
    const Quality all = quality(image, blocks, 1);
    std::printf("  %-6s %6.2f dB  mean %5.2f %%  %6.2f Mtexel/s  cube %6.2f s", name,
                decibels(all.squared_error, values), 100 * all.mean_error, values / 3e6 / seconds,
                seconds * 8.39e6 / (values / 3) / 2);
    if (stride) {
      const int count = (image.width() / 4 * (image.height() / 4) + stride - 1) / stride;
      std::printf("  loss %.3f dB over %d blocks",
                  10 * std::log10(quality(image, blocks, stride).squared_error / least), count);
    }
    std::printf("\n");
  }
}

}  // namespace

int main(int argc, char** argv) {
  int threads = 1, stride = 0;
  std::vector<std::string> files;
  for (int i = 1; i < argc; ++i) {
    if (!std::strcmp(argv[i], "--threads") && i + 1 < argc)
      threads = std::atoi(argv[++i]);
    else if (!std::strcmp(argv[i], "--exhaustive") && i + 1 < argc)
      stride = std::max(1, std::atoi(argv[++i]));
    else
      files.emplace_back(argv[i]);
  }
  if (files.empty()) return std::fprintf(stderr, "usage: bc6h_bench [--threads N] [--exhaustive STRIDE] FILE...\n"), 2;
  std::printf("SIMD %s\n", simd_target());
  for (const std::string& file : files) {
    const Result<PictureFile> pictures = read_pictures(file, {});
    if (!pictures || pictures->pictures[0].channels.count() < 3) {
      std::fprintf(stderr, "%s\n", pictures ? "not in colour" : pictures.error().message.c_str());
      continue;
    }
    std::printf("%s\n", file.c_str());
    print(pictures->pictures[0].image, threads, stride);
  }
}
