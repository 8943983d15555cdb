// SPDX-License-Identifier: Apache-2.0
// Quality and rate of resample() on analytic panoramas (see analytic.h).
//
//     resample_bench [OPTION...] SOURCE_HEIGHT TARGET_HEIGHT...
//       --from LAYOUT, --to LAYOUT, --filter NAME, --samples N, --band SHARE (0.98), --seed N, --runs N, --rate-only
//       --seams        quality near seams as well: of both, within 12 texels of each
//       --paint FILE   writes the source, and does no more
//       --judge FILE   prints the quality of FILE, made of that source by another program; --packing NAME
//
// Rates are medians of the runs, of the wall's clock and of the processor's, for whole calls of resample(): aprons,
// prefilter and the mean's correction included.
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include "analytic.h"
#include "window_kernels.h"

namespace {

using namespace envconv;
using namespace envconv::bench;

struct Options {
  std::string from = "latlong", to = "cube", filter = "auto", paint, judge, packing;
  int runs = 5, samples = 0;
  unsigned seed = 20260921;
  double band = 0.98;
  bool rate_only = false, seams = false;
  std::vector<int> heights;
};

Options parsed(int argc, char** argv) {
  Options o;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const auto value = [&] { return i + 1 < argc ? argv[++i] : ""; };
    if (word == "--from")
      o.from = value();
    else if (word == "--to")
      o.to = value();
    else if (word == "--filter")
      o.filter = value();
    else if (word == "--paint")
      o.paint = value();
    else if (word == "--judge")
      o.judge = value();
    else if (word == "--packing")
      o.packing = value();
    else if (word == "--runs")
      o.runs = std::max(1, std::atoi(value()));
    else if (word == "--samples")
      o.samples = std::atoi(value());
    else if (word == "--seed")
      o.seed = static_cast<unsigned>(std::atoi(value()));
    else if (word == "--seams")
      o.seams = true;
    else if (word == "--band")
      o.band = std::atof(value());
    else if (word == "--rate-only")
      o.rate_only = true;
    else
      o.heights.push_back(std::atoi(word.c_str()));
  }
  return o;
}

void print_quality(const EnvImage& out, const Options& o, int height, const Signal& signal) {
  const Estimate estimates[] = {estimate_of(out)};
  const auto print = [](const char* where, const Rgb& q) {
    std::printf("  %sPSNR R %.1f  G %.1f  B %.1f dB\n", where, q[0], q[1], q[2]);
  };
  print("", quality(*out.layout, height, signal, estimates).front());
  if (!o.seams) return;
  constexpr double near = 12, most = 1e5;
  const Layout& source = *find_layout(o.from);
  const auto judge = [&](const char* where, const Chosen& chosen) {
    print(where, quality(*out.layout, height, signal, estimates, most, chosen).front());
  };
  const Chosen by_source = [&](Vec3 d) { return near_seam(source, o.heights[0], d, near); };
  const Chosen by_target = [&](Vec3 d) { return near_seam(*out.layout, height, d, near); };
  judge("12 texels from the source's seams:  ", by_source);
  judge("12 texels from the target's seams:  ", by_target);
  judge("elsewhere:                          ", [&](Vec3 d) { return !by_source(d) && !by_target(d); });
}

// Values as they are, whatever the format.
Result<WriteReport> write(const std::string& path, EnvImage image) {
  std::vector<Picture> pictures(1);
  pictures[0].image = std::move(image.faces.front());
  pictures[0].channels = image.channels;
  WriteOptions options;
  options.type = path.ends_with(".png") ? PixelType::uint16 : PixelType::float32;
  options.encoding = Encoding::as_is;
  if (path.ends_with(".exr")) options.compression = "none";
  return write_pictures(path, pictures, options);
}

Result<EnvImage> read(const std::string& path, const Layout& layout, const std::string& packing_name) {
  ReadOptions options;
  options.as_stored = true;
  ENVCONV_TRY(PictureFile file, read_pictures(path, options));
  EnvImage image;
  image.layout = &layout;
  image.placement = layout.info().placement;
  image.channels = file.pictures.front().channels;
  const Packing* packing = packing_name.empty() ? &default_packing(layout) : find_packing(packing_name);
  if (!packing || image.channels.count() < 3) return Error{ErrorCode::usage, "no such packing, or no colour"};
  if (file.pictures.size() == 1) {
    ENVCONV_TRY(image.faces, unpack(layout, *packing, std::move(file.pictures.front().image)));
  } else {
    for (Picture& picture : file.pictures) image.faces.push_back(std::move(picture.image));
  }
  return image;
}

int measure(const EnvImage& source, const ResampleOptions& options, const Options& o, const Signal& signal) {
  std::vector<double> wall, cpu;
  EnvImage out;
  for (int run = 0; run < o.runs; ++run) {
    Result<EnvImage> result = Error{ErrorCode::internal, ""};
    const Seconds s = timed([&] { result = resample(source, options); });
    if (!result) return std::fprintf(stderr, "%s\n", result.error().message.c_str()), 1;
    wall.push_back(s.wall), cpu.push_back(s.cpu);
    out = std::move(*result);
  }
  std::printf("%s %d -> %s %d: %.4f s, %.1f Mtexel/s, %.4f s of processor\n", o.from.c_str(), o.heights[0],
              o.to.c_str(), options.height, median(wall), static_cast<double>(out.texel_count()) / median(wall) / 1e6,
              median(cpu));
  if (!o.rate_only) print_quality(out, o, options.height, signal);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const Options o = parsed(argc, argv);
  const Layout *source = find_layout(o.from), *target = find_layout(o.to);
  if (!source || !target || !find_filter(o.filter) || o.heights.size() < 2) {
    std::fprintf(stderr, "usage: resample_bench [OPTION...] SOURCE_HEIGHT TARGET_HEIGHT...: see the file's head\n");
    return 2;
  }
  if (o.paint.empty() && o.judge.empty()) std::printf("SIMD %s, filter %s\n", simd_target(), o.filter.c_str());
  for (std::size_t k = 1; k < o.heights.size(); ++k) {
    const Signal signal(nyquist(*target, o.heights[k]), o.band * nyquist(*source, o.heights[0]), o.seed);
    if (!o.judge.empty()) {
      const Result<EnvImage> image = read(o.judge, *target, o.packing);
      if (!image) return std::fprintf(stderr, "%s\n", image.error().message.c_str()), 1;
      print_quality(*image, o, o.heights[k], signal);
      continue;
    }
    EnvImage image = paint(*source, o.heights[0], signal);
    if (!o.paint.empty()) {
      const Result<WriteReport> report = write(o.paint, std::move(image));
      if (!report) return std::fprintf(stderr, "%s\n", report.error().message.c_str()), 1;
      return 0;
    }
    ResampleOptions options;
    options.layout = target;
    options.height = o.heights[k];
    options.placement = target->info().placement;
    options.filter = find_filter(o.filter);
    options.samples = o.samples;
    if (const int status = measure(image, options, o, signal)) return status;
  }
}
