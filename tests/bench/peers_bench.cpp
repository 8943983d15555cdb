// SPDX-License-Identifier: Apache-2.0
// Rate and quality of resample() beside OpenCV's, in one run, on both cores; medians of the runs, which take turns.
//
//     peers_bench [--runs N] [--only PART_OF_NAME] [--all] [--quality] [--table] [SOURCE_HEIGHT FACE_SIZE]...
//     (default: 2048 1024, 4096 256; --all: more of our filters; --quality: see analytic.h; --table: for programs)
//
// A lat-long of RGB floats becomes the six faces of a cube.
//   remap linear             cv::remap, INTER_LINEAR, coordinate maps given, output allocated before
//   remap linear with maps   the same with the maps made each time (cv::parallel_for_, atan2 and asin)
//   remap Lanczos4           cv::remap, INTER_LANCZOS4, maps given
//   resize area              cv::resize, INTER_AREA, of the source by the ratio of the heights: no change of layout
//   resize, remap linear     that, then remap; where the source is at least twice as fine
// Their source has texels beyond its edges, so that they see the seam and the poles as they should; making these is not
// timed.  Seconds of the wall's clock, and of the processor's, which other programs at work disturb less.
// Ours are whole calls: coordinates, aprons, prefilter and the mean's correction; the output's memory is used
// again, as remap's is.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "analytic.h"

namespace {

using namespace envconv;
using namespace envconv::bench;

struct Rival {
  std::string name;
  std::function<void()> run;
  Estimate estimate = {};  // of what it made last
  std::vector<double> wall = {}, cpu = {};
};

// Where the texels of a cube's face lie in a lat-long of the given size, in texels; row by row on all cores.
void make_maps(const Layout& cube, int face, int size, int height, int border, cv::Mat& x, cv::Mat& y) {
  x.create(size, size, CV_32F), y.create(size, size, CV_32F);
  const Vec3 corner = cube.direction(face, 0, 0), right = cube.direction(face, 1, 0), down = cube.direction(face, 0, 1);
  const double edge = std::sqrt(3.0);  // directions of corners, on the cube of half-edge 1
  const Vec3 a = edge * corner, u = edge * (right - corner), v = edge * (down - corner);
  const float width = 2 * static_cast<float>(height), inverse_pi = static_cast<float>(1 / 3.14159265358979323846);
  cv::parallel_for_(cv::Range(0, size), [&](const cv::Range& rows) {
    for (int j = rows.start; j < rows.end; ++j) {
      float *to_x = x.ptr<float>(j), *to_y = y.ptr<float>(j);
      const Vec3 start = a + ((j + 0.5) / size) * v;
      for (int i = 0; i < size; ++i) {
        const double t = (i + 0.5) / size;
        const float dx = static_cast<float>(start.x + t * u.x), dy = static_cast<float>(start.y + t * u.y),
                    dz = static_cast<float>(start.z + t * u.z);
        const float longitude = std::atan2(dx, dz), latitude = std::asin(dy / std::sqrt(dx * dx + dy * dy + dz * dz));
        to_x[i] = (0.5f + 0.5f * longitude * inverse_pi) * width - 0.5f + static_cast<float>(border);
        to_y[i] = (0.5f - latitude * inverse_pi) * static_cast<float>(height) - 0.5f + static_cast<float>(border);
      }
    }
  });
}

// The texels with `border` of those that lie beyond the edges: around the seam, and down the opposite meridian.
cv::Mat padded(const cv::Mat& pixels, int border) {
  cv::Mat out(pixels.rows + 2 * border, pixels.cols + 2 * border, pixels.type());
  for (int y = 0; y < out.rows; ++y)
    for (int x = 0; x < out.cols; ++x) {
      int j = y - border, i = x - border + pixels.cols;
      if (j < 0 || j >= pixels.rows) j = (j < 0 ? -1 : 2 * pixels.rows - 1) - j, i += pixels.cols / 2;
      out.at<cv::Vec3f>(y, x) = pixels.at<cv::Vec3f>(j, i % pixels.cols);
    }
  return out;
}

// cv::remap of a padded lat-long to the faces of a cube.
class Remap {
 public:
  Remap(const Layout& cube, int size) : cube_(cube), size_(size), x_(6), y_(6), faces_(6) {
    for (cv::Mat& face : faces_) face.create(size, size, CV_32FC3);
  }
  void set_source(const cv::Mat& pixels) {
    source_ = padded(pixels, border);
    height_ = pixels.rows;
  }
  void make_maps() {
    for (int f = 0; f < 6; ++f)
      ::make_maps(cube_, f, size_, height_, border, x_[static_cast<std::size_t>(f)], y_[static_cast<std::size_t>(f)]);
  }
  void run(int interpolation) {
    for (std::size_t f = 0; f < 6; ++f)
      cv::remap(source_, faces_[f], x_[f], y_[f], interpolation, cv::BORDER_REPLICATE);
  }
  Rgb at(int face, int x, int y) const {
    const auto p = faces_[static_cast<std::size_t>(face)].at<cv::Vec3f>(y, x);
    return {p[0], p[1], p[2]};
  }

 private:
  static constexpr int border = 8;
  const Layout& cube_;
  int size_, height_ = 0;
  cv::Mat source_;
  std::vector<cv::Mat> x_, y_, faces_;
};

struct Options {
  int runs = 5;
  bool all = false, quality = false, table = false;
  std::string only;
};

struct Ours {
  const char* filter;
  int samples;
};

void run(int height, int size, const Options& o) {
  const Layout &latlong = *find_layout("latlong"), &cube = *find_layout("cube");
  const Signal signal(nyquist(cube, size), 0.98 * nyquist(latlong, height));
  const EnvImage source = paint(latlong, height, signal);
  Image copy = source.faces[0].clone();
  const cv::Mat pixels(height, 2 * height, CV_32FC3, copy.data());
  Remap remap(cube, size), remap_small(cube, size);
  remap.set_source(pixels);
  remap.make_maps();
  const auto of_remap = [&](int f, int x, int y) { return remap.at(f, x, y); };
  EnvImage last;
  const auto of_ours = [&](int f, int x, int y) { return estimate_of(last)(f, x, y); };
  const auto ours = [&](const Ours& how) {
    ResampleOptions options;
    options.layout = &cube;
    options.height = size;
    options.filter = find_filter(how.filter);
    options.samples = how.samples;
    Result<EnvImage> result = resample(source, options, std::move(last));
    if (!result) std::exit(1);
    last = std::move(*result);
  };
  std::vector<Rival> rivals;
  rivals.push_back({"remap linear", [&] { remap.run(cv::INTER_LINEAR); }, of_remap});
  rivals.push_back({"remap linear with maps", [&] { remap.make_maps(), remap.run(cv::INTER_LINEAR); }, of_remap});
  rivals.push_back({"remap Lanczos4", [&] { remap.run(cv::INTER_LANCZOS4); }, of_remap});
  cv::Mat small;
  const int factor = std::max(1, height / (2 * size));
  const auto resize = [&] {
    cv::resize(pixels, small, cv::Size(2 * height / factor, height / factor), 0, 0, cv::INTER_AREA);
  };
  rivals.push_back({"resize area", resize});
  if (factor > 1) {
    resize(), remap_small.set_source(small), remap_small.make_maps();
    rivals.push_back({"resize, remap linear", [&] { resize(), remap_small.run(cv::INTER_LINEAR); },
                      [&](int f, int x, int y) { return remap_small.at(f, x, y); }});
  }
  std::vector<Ours> all = {{"bilinear", 0}, {"bicubic", 0}, {"auto", 0}};
  if (o.all)
    for (const Ours& more : {Ours{"lanczos", 0},
                             {"gaussian", 0},
                             {"box", 0},
                             {"nearest", 0},
                             {"auto", 1},
                             {"auto", 2},
                             {"auto", 4},
                             {"bilinear", 1},
                             {"bicubic", 1},
                             {"bicubic", 4},
                             {"lanczos", 4}})
      all.push_back(more);
  for (const Ours& how : all)
    rivals.push_back({std::string("envconv ") + how.filter +
                          (how.samples > 0 ? ", " + std::to_string(how.samples) +
                                                 (how.samples > 1 ? " samples a side" : " sample a side")
                                           : ""),
                      [&ours, how] { ours(how); }, of_ours});
  if (!o.only.empty()) std::erase_if(rivals, [&](const Rival& r) { return r.name.find(o.only) == std::string::npos; });
  for (int i = 0; i <= o.runs; ++i)
    for (Rival& rival : rivals) {
      const Seconds s = timed(rival.run);
      if (i > 0) rival.wall.push_back(s.wall), rival.cpu.push_back(s.cpu);
    }
  if (!o.table) std::printf("latlong %dx%d to a cube of %d, median of %d\n", 2 * height, height, size, o.runs);
  for (Rival& rival : rivals) {
    const double wall = median(rival.wall), cpu = median(rival.cpu);
    Rgb q{};
    if (o.quality && rival.estimate) {
      rival.run();
      q = quality(cube, size, signal, std::span(&rival.estimate, 1), 1e4).front();
    }
    if (o.table) {
      std::printf("%d %d|%s|%.5f|%.5f|%.1f|%.1f|%.1f\n", height, size, rival.name.c_str(), wall, cpu, q[0], q[1], q[2]);
      continue;
    }
    std::printf("  %-36s %8.4f s  %6.1f Mtexel/s  %8.4f s of processor", rival.name.c_str(), wall,
                6e-6 * size * size / wall, cpu);
    if (o.only.empty())
      std::printf("   x %.2f remap, x %.2f remap with maps, time / resize %.2f", median(rivals[0].wall) / wall,
                  median(rivals[1].wall) / wall, wall / median(rivals[3].wall));
    if (o.quality && rival.estimate) std::printf("  R %.1f  G %.1f  B %.1f dB", q[0], q[1], q[2]);
    std::printf("\n");
  }
}

}  // namespace

int main(int argc, char** argv) {
  Options o;
  std::vector<int> sizes;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--runs" && i + 1 < argc)
      o.runs = std::max(1, std::atoi(argv[++i]));
    else if (word == "--only" && i + 1 < argc)
      o.only = argv[++i];
    else if (word == "--all")
      o.all = true;
    else if (word == "--quality")
      o.quality = true;
    else if (word == "--table")
      o.table = true;
    else
      sizes.push_back(std::atoi(word.c_str()));
  }
  if (sizes.empty()) sizes = {2048, 1024, 4096, 256};
  for (std::size_t i = 0; i + 1 < sizes.size(); i += 2) run(sizes[i], sizes[i + 1], o);
}
