// SPDX-License-Identifier: Apache-2.0
// Every ordered pair of layouts: how near resample() comes to the best that the source's texels allow, and at what
// rate.
//
//     pairs_bench quality|rates|threads [--layouts A,B,...] [--from A,B,...] [--filter NAME] [--samples N]
//     [--runs N] [--seed N] [--texels SOURCE,TARGET]
//
// quality: PSNR of the filter (see analytic.h) beside that of the best attainable: a sinc under a Kaiser window, 16
//   taps a side, integrated over each texel's footprint by 4 x 8x8 Gauss-Legendre nodes or more (nodes are never
//   farther apart than half a source texel: as exact as 32x32 equal steps, and more).  Texels beyond a face's edges are
//   painted where the layout's formula goes on, so no seam limits it: an upper bound for what can be read across them.
// rates: processor time per output texel of each pair, relative to lat-long to cube, which is measured with every row
//   anew: of its times and of a pair's the least.
// threads: time with one and with two threads; the least of the runs.
// --texels: of sources and of targets, about; 5.2e5,3.9e5 as at the pair 1024x512 and 256.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include "analytic.h"
#include "window_kernels.h"

namespace {

using namespace envconv;
using namespace envconv::bench;

// The reconstruction that others are measured against.
class Best {
 public:
  Best(const Layout& layout, int height, const Signal& signal) : layout_(layout) {
    for (std::size_t i = 0; i <= phases; ++i) {
      const double f = static_cast<double>(i) / phases;
      double sum = 0;
      for (int k = 0; k < taps; ++k) {
        const double t = k - (taps / 2 - 1) - f, r = t / (taps / 2);
        const double sinc = std::abs(t) < 1e-12 ? 1.0 : std::sin(M_PI * t) / (M_PI * t);
        const double w = std::abs(r) < 1 ? sinc * std::cyl_bessel_i(0.0, 8.5 * std::sqrt(1 - r * r)) : 0;
        weights_[i][static_cast<std::size_t>(k)] = static_cast<float>(w);
        sum += w;
      }
      for (float& w : weights_[i]) w = static_cast<float>(static_cast<double>(w) / sum);
    }
    const Placement placement = layout.info().placement;
    for (int f = 0; f < layout.face_count(); ++f) {
      Face face;
      face.size = face_size(layout, f, height);
      face.pitch = static_cast<std::size_t>(face.size.width + 2 * apron);
      const std::size_t rows = static_cast<std::size_t>(face.size.height + 2 * apron);
      for (auto& plane : face.planes) plane.resize(face.pitch * rows);
      tbb::parallel_for(std::size_t{0}, rows, [&](std::size_t y) {
        for (std::size_t x = 0; x < face.pitch; ++x) {
          const Rgb rgb =
              signal(layout.direction(f, u_from_texel(static_cast<double>(x) - apron, face.size.width, placement),
                                      u_from_texel(static_cast<double>(y) - apron, face.size.height, placement)));
          for (std::size_t c = 0; c < 3; ++c) face.planes[c][y * face.pitch + x] = static_cast<float>(rgb[c]);
        }
      });
      faces_.push_back(std::move(face));
    }
  }

  Rgb at(Vec3 d) const {
    const Location at = layout_.locate(d);
    const Face& face = faces_[static_cast<std::size_t>(at.face)];
    const Placement placement = layout_.info().placement;
    const double x = texel_from_u(at.u, face.size.width, placement),
                 y = texel_from_u(at.v, face.size.height, placement);
    const auto wx = weights(x - std::floor(x)), wy = weights(y - std::floor(y));
    const auto left = static_cast<std::size_t>(static_cast<int>(std::floor(x)) + apron - (taps / 2 - 1));
    const auto top = static_cast<std::size_t>(static_cast<int>(std::floor(y)) + apron - (taps / 2 - 1));
    Rgb rgb{};
    for (std::size_t c = 0; c < 3; ++c)
      for (std::size_t j = 0; j < taps; ++j) {
        const float* p = &face.planes[c][(top + j) * face.pitch + left];
        std::array<float, 4> row{};
        for (std::size_t i = 0; i < taps; i += 4)
          for (std::size_t k = 0; k < 4; ++k) row[k] += wx[i + k] * p[i + k];
        rgb[c] += static_cast<double>(wy[j]) * static_cast<double>((row[0] + row[1]) + (row[2] + row[3]));
      }
    return rgb;
  }

 private:
  static constexpr int taps = 16, apron = taps / 2 + 1;
  static constexpr std::size_t phases = 2048;
  using Weights = std::array<float, taps>;
  struct Face {
    Size size;
    std::size_t pitch;
    std::array<std::vector<float>, 3> planes;
  };
  Weights weights(double f) const {
    const double at = f * phases;
    const auto i = std::min(static_cast<std::size_t>(at), phases - 1);
    const float t = static_cast<float>(at - static_cast<double>(i));
    Weights w;
    for (std::size_t k = 0; k < taps; ++k) w[k] = weights_[i][k] + t * (weights_[i + 1][k] - weights_[i][k]);
    return w;
  }
  const Layout& layout_;
  std::array<Weights, phases + 1> weights_;
  std::vector<Face> faces_;
};

struct Options {
  std::vector<const Layout*> from, to;
  const Filter* filter = find_filter("auto");
  int runs = 5, samples = 0;
  unsigned seed = 1;
  double source_texels = 5.2e5, target_texels = 3.9e5;
};

ResampleOptions resampling(const Options& options, const Layout& to) {
  ResampleOptions r;
  r.layout = &to;
  r.height = height_of(to, options.target_texels);
  r.placement = to.info().placement;
  r.filter = options.filter;
  r.samples = options.samples;
  return r;
}

// As the tool does it: the source's own texels stay.
EnvImage converted(EnvImage&& source, const ResampleOptions& options, EnvImage recycled = {}) {
  Result<EnvImage> result = resample(std::move(source), options, std::move(recycled));
  if (!result) std::exit((std::fprintf(stderr, "%s\n", result.error().message.c_str()), 1));
  return std::move(*result);
}

void print_quality(const Options& options) {
  const int least_nodes = static_cast<int>(2 * std::sqrt(options.source_texels / options.target_texels) * 1.6);
  const std::vector<FootprintNode> nodes = footprint_nodes(std::max(8, least_nodes));
  std::printf("| from | to | %s R | G | B | best R | G | B | short by R | G | B |\n",
              std::string(options.filter->name).c_str());
  std::printf("|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (const Layout* from : options.from)
    for (const Layout* to : options.to) {
      if (from == to) continue;
      const int height = height_of(*from, options.source_texels);
      const ResampleOptions r = resampling(options, *to);
      // What is enlarged holds no more than the source did.
      const double held = nyquist(*from, height), wanted = nyquist(*to, r.height);
      const bool grows = options.target_texels > options.source_texels;
      const Signal signal(grows ? std::min(held, wanted) : wanted, 0.98 * held, options.seed);
      const EnvImage out = converted(paint(*from, height, signal), r);
      const auto best = std::make_unique<Best>(*from, height, signal);
      const Estimate estimates[] = {estimate_of(out), [&](int f, int x, int y) {
                                      return footprint_mean(*to, f, x, y, face_size(*to, f, r.height), r.placement,
                                                            nodes, [&](Vec3 d) { return best->at(d); });
                                    }};
      const std::vector<Rgb> q = quality(*to, r.height, signal, estimates, 1e4);
      std::printf("| %s | %s |", std::string(from->name()).c_str(), std::string(to->name()).c_str());
      for (const Rgb& rgb : q) std::printf(" %.1f | %.1f | %.1f |", rgb[0], rgb[1], rgb[2]);
      for (std::size_t c = 0; c < 3; ++c) std::printf(" %.1f |", q[1][c] - q[0][c]);
      std::printf("\n");
      std::fflush(stdout);
    }
}

// What is resampled where only time counts.
EnvImage gradient(const Options& options, const Layout& layout) {
  return paint(layout, height_of(layout, options.source_texels), [](Vec3 d) {
    return Rgb{0.5 + 0.4 * d.x, 0.5 + 0.4 * d.y, 0.5 + 0.4 * d.z};
  });
}

// Processor time per output texel, in nanoseconds: the least of the runs.
double nanoseconds(const Options& options, EnvImage&& source, const Layout& to) {
  const ResampleOptions r = resampling(options, to);
  EnvImage out;
  double least = 1e30;
  for (int run = 0; run <= options.runs; ++run) {
    const Seconds s = timed([&] { out = converted(std::move(source), r, std::move(out)); });
    if (run > 0) least = std::min(least, s.cpu);
  }
  return 1e9 * least / static_cast<double>(out.texel_count());
}

void print_rates(const Options& options) {
  const Layout &latlong = *find_layout("latlong"), &cube = *find_layout("cube");
  double unit = 1e30;
  std::vector<double> times;  // by row
  for (const Layout* from : options.from) {
    unit = std::min(unit, nanoseconds(options, gradient(options, latlong), cube));
    EnvImage source = gradient(options, *from);
    for (const Layout* to : options.to) times.push_back(from == to ? 0 : nanoseconds(options, std::move(source), *to));
  }
  std::printf("lat-long to cube: %.1f ns of processor time a texel\n\n| from \\ to |", unit);
  for (const Layout* to : options.to) std::printf(" %s |", std::string(to->name()).c_str());
  std::printf("\n|---|");
  for (std::size_t i = 0; i < options.to.size(); ++i) std::printf("---|");
  std::printf("\n");
  auto time = times.begin();
  for (const Layout* from : options.from) {
    std::printf("| %s |", std::string(from->name()).c_str());
    for (const Layout* to : options.to) {
      if (from == to)
        std::printf(" |");
      else
        std::printf(" %.2f |", *time / unit);
      ++time;
    }
    std::printf("\n");
  }
}

void print_threads(const Options& options) {
  for (const Layout* from : options.from)
    for (const Layout* to : options.to) {
      if (from == to) continue;
      EnvImage source = gradient(options, *from);
      double least[2] = {1e30, 1e30};
      EnvImage out;
      for (int run = 0; run <= options.runs; ++run)
        for (int threads = 1; threads <= 2; ++threads) {
          ResampleOptions r = resampling(options, *to);
          r.threads = threads;
          const Seconds s = timed([&] { out = converted(std::move(source), r, std::move(out)); });
          if (run > 0) least[threads - 1] = std::min(least[threads - 1], s.wall);
        }
      std::printf("%s to %s: %.4f s, %.4f s: x %.2f\n", std::string(from->name()).c_str(),
                  std::string(to->name()).c_str(), least[0], least[1], least[0] / least[1]);
      std::fflush(stdout);
    }
}

std::vector<const Layout*> layouts_of(const std::string& list) {
  std::vector<const Layout*> layouts;
  for (std::size_t at = 0; at <= list.size();) {
    const std::size_t end = std::min(list.find(',', at), list.size());
    const std::string name = list.substr(at, end - at);
    if (!find_layout(name)) std::exit((std::fprintf(stderr, "%s: no such layout\n", name.c_str()), 2));
    layouts.push_back(find_layout(name));
    at = end + 1;
  }
  return layouts;
}

}  // namespace

int main(int argc, char** argv) {
  Options options;
  options.from = options.to = layouts_of("latlong,cube,isocube,octahedral,tennis-ball,diamond-12,sphere-map");
  const std::string what = argc > 1 ? argv[1] : "";
  for (int i = 2; i + 1 < argc; i += 2) {
    const std::string word = argv[i], value = argv[i + 1];
    if (word == "--layouts") options.from = options.to = layouts_of(value);
    if (word == "--from") options.from = layouts_of(value);
    if (word == "--filter") options.filter = find_filter(value);
    if (word == "--samples") options.samples = std::atoi(value.c_str());
    if (word == "--runs") options.runs = std::max(1, std::atoi(value.c_str()));
    if (word == "--seed") options.seed = static_cast<unsigned>(std::atoi(value.c_str()));
    if (word == "--texels") {
      options.source_texels = std::atof(value.c_str());
      options.target_texels = std::atof(value.c_str() + std::min(value.size(), value.find(',') + 1));
    }
  }
  if (!options.filter || !(options.source_texels >= 1) || !(options.target_texels >= 1)) return 2;
  if (what == "quality") return print_quality(options), 0;
  if (what == "rates") return print_rates(options), 0;
  if (what == "threads") return print_threads(options), 0;
  std::fprintf(stderr, "usage: pairs_bench quality|rates|threads [OPTION VALUE]...: see the file's head\n");
  return 2;
}
