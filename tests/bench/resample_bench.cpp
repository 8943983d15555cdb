// SPDX-License-Identifier: Apache-2.0
// Quality and rate of resample() on analytic panoramas.
//
//     resample_bench [--from LAYOUT] [--to LAYOUT] [--filter NAME] [--samples N] [--band SHARE] [--runs N]
//     [--rate-only] SOURCE_HEIGHT TARGET_HEIGHT...
//
// Three signals are painted into the source, point by point at its texels' centres:
//   R  plane waves cos(k.d + p) with |k| up to the target's Nyquist limit,
//   G  the same up to half of it,
//   B  zone plates about the six axes, whose frequency grows from 0 to --band (0.98) of the source's Nyquist limit.
// The truth for an output texel is the signal's mean over the texel's footprint, by Gauss-Legendre quadrature weighted
// with solid angle.  PSNR is 10 log10(1 / mean squared error), the mean taken over the sphere.  Rates are medians of
// the runs, whole calls of resample(): aprons, prefilter and the mean's correction included.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <string>
#include <vector>

#include "envconv.h"
#include "quadrature.h"
#include "read_kernels.h"

namespace {

using namespace envconv;

constexpr double pi = 3.14159265358979323846;

struct Wave {
  Vec3 k;
  double amplitude, phase;
};

// Highest angular frequency, in radians per radian, that a layout holds everywhere: two texels of the widest kind a
// wave.
double nyquist(const Layout& layout, int height) {
  const double requirement = figures(layout).sampling_requirement;
  const double texels = static_cast<double>(texel_count(layout, height));
  return std::isfinite(requirement) ? pi * std::sqrt(texels / requirement) : pi * std::sqrt(texels / (4 * pi));
}

class Signal {
 public:
  Signal(double target_nyquist, double highest) : chirp_(highest / (2 * std::acos(1 / std::sqrt(3.0)))) {
    std::mt19937_64 random(20260921);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> uniform(0, 1);
    for (const double limit : {target_nyquist, 0.5 * target_nyquist})
      for (int i = 0; i < 24; ++i) {
        const Vec3 d = normalize({normal(random), normal(random), normal(random)});
        waves_[limit < target_nyquist].push_back(
            {(limit * (0.3 + 0.7 * uniform(random))) * d, 0.03, 2 * pi * uniform(random)});
      }
  }
  void at(Vec3 d, double* rgb) const {
    for (int c = 0; c < 2; ++c) {
      rgb[c] = 0.5;
      for (const Wave& w : waves_[c]) rgb[c] += w.amplitude * std::cos(dot(w.k, d) + w.phase);
    }
    const double angle = std::acos(std::min(1.0, std::max({std::abs(d.x), std::abs(d.y), std::abs(d.z)})));
    rgb[2] = 0.5 + 0.5 * std::cos(chirp_ * angle * angle);
  }

 private:
  std::vector<Wave> waves_[2];
  double chirp_;  // the zone plates' phase is chirp * angle^2
};

EnvImage paint(const Layout& layout, int height, const Signal& signal) {
  EnvImage image;
  image.layout = &layout;
  image.placement = layout.info().placement;
  image.channels = Channels::standard(3);
  for (int f = 0; f < layout.face_count(); ++f) {
    const Size size = face_size(layout, f, height);
    Image face(size.width, size.height, 3);
    tbb::parallel_for(0, size.height, [&](int y) {
      for (int x = 0; x < size.width; ++x) {
        double rgb[3];
        signal.at(layout.direction(f, u_from_texel(x, size.width, image.placement),
                                   u_from_texel(y, size.height, image.placement)),
                  rgb);
        for (int c = 0; c < 3; ++c) face.at(x, y)[c] = static_cast<float>(rgb[c]);
      }
    });
    image.faces.push_back(std::move(face));
  }
  return image;
}

// On a grid of at most about 200000 texels, evenly strewn.
void print_quality(const EnvImage& out, const Signal& signal) {
  const Layout& layout = *out.layout;
  const Quadrature q = box_quadrature(6);
  const int step = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(out.texel_count()) / 2e5)));
  double error[3]{}, total = 0;
  for (int f = 0; f < layout.face_count(); ++f) {
    const Image& face = out.faces[static_cast<std::size_t>(f)];
    std::vector<std::array<double, 4>> rows(static_cast<std::size_t>(face.height()));
    tbb::parallel_for(0, face.height(), [&](int y) {
      if (y % step) return;
      auto& row = rows[static_cast<std::size_t>(y)];
      for (int x = (y / step) % step; x < face.width(); x += step) {
        if (!layout.owns(f, u_from_texel(x, face.width(), out.placement),
                         u_from_texel(y, face.height(), out.placement)))
          continue;
        double truth[3]{}, weight = 0;
        for (int j = 0; j < q.count(); ++j)
          for (int i = 0; i < q.count(); ++i) {
            const auto a = static_cast<std::size_t>(i), b = static_cast<std::size_t>(j);
            const DirectionJet jet = layout.direction_jet(f, u_from_texel(x + q.offset[a], face.width(), out.placement),
                                                          u_from_texel(y + q.offset[b], face.height(), out.placement));
            const double w = q.weight[a] * q.weight[b] * length(cross(jet.du, jet.dv));
            double rgb[3];
            signal.at(jet.d, rgb);
            for (int c = 0; c < 3; ++c) truth[c] += w * rgb[c];
            weight += w;
          }
        for (int c = 0; c < 3; ++c) {
          const double e = static_cast<double>(face.at(x, y)[c]) - truth[c] / weight;
          row[static_cast<std::size_t>(c)] += weight * e * e;
        }
        row[3] += weight;
      }
    });
    for (const auto& row : rows) {
      for (std::size_t c = 0; c < 3; ++c) error[c] += row[c];
      total += row[3];
    }
  }
  std::printf("  PSNR R %.1f  G %.1f  B %.1f dB\n", 10 * std::log10(total / error[0]),
              10 * std::log10(total / error[1]), 10 * std::log10(total / error[2]));
}

}  // namespace

int main(int argc, char** argv) {
  std::string from = "latlong", to = "cube", filter = "auto";
  int runs = 5, samples = 0;
  double band = 0.98;
  bool quality = true;
  std::vector<int> heights;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const auto value = [&] { return i + 1 < argc ? argv[++i] : ""; };
    if (word == "--from")
      from = value();
    else if (word == "--to")
      to = value();
    else if (word == "--filter")
      filter = value();
    else if (word == "--runs")
      runs = std::max(1, std::atoi(value()));
    else if (word == "--samples")
      samples = std::atoi(value());
    else if (word == "--band")
      band = std::atof(value());
    else if (word == "--rate-only")
      quality = false;
    else
      heights.push_back(std::atoi(word.c_str()));
  }
  const Layout *source = find_layout(from), *target = find_layout(to);
  if (!source || !target || !find_filter(filter) || heights.size() < 2) {
    std::fprintf(stderr,
                 "usage: resample_bench [--from LAYOUT] [--to LAYOUT] [--filter NAME] [--samples N] [--band SHARE] "
                 "[--runs N] [--rate-only] "
                 "SOURCE_HEIGHT TARGET_HEIGHT...\n");
    return 2;
  }
  std::printf("SIMD %s, filter %s\n", simd_target(), filter.c_str());
  for (std::size_t k = 1; k < heights.size(); ++k) {
    const Signal signal(nyquist(*target, heights[k]), band * nyquist(*source, heights[0]));
    const EnvImage image = paint(*source, heights[0], signal);
    ResampleOptions options;
    options.layout = target;
    options.height = heights[k];
    options.placement = target->info().placement;
    options.filter = find_filter(filter);
    options.samples = samples;
    std::vector<double> seconds;
    EnvImage out;
    for (int run = 0; run < runs; ++run) {
      const auto start = std::chrono::steady_clock::now();
      Result<EnvImage> result = resample(image, options);
      seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
      if (!result) return std::fprintf(stderr, "%s\n", result.error().message.c_str()), 1;
      out = std::move(*result);
    }
    std::nth_element(seconds.begin(), seconds.begin() + runs / 2, seconds.end());
    const double median = seconds[static_cast<std::size_t>(runs / 2)];
    std::printf("%s %d -> %s %d: %.4f s, %.1f Mtexel/s\n", from.c_str(), heights[0], to.c_str(), heights[k], median,
                static_cast<double>(out.texel_count()) / median / 1e6);
    if (quality) print_quality(out, signal);
  }
}
