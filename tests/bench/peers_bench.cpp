// SPDX-License-Identifier: Apache-2.0
// Rate of resample() beside OpenCV's, in one run, on both cores; medians of the runs, which take turns.
//
//     peers_bench [--runs N] [--only PART_OF_NAME] [SOURCE_HEIGHT FACE_SIZE]...      (default: 2048 1024, 4096 256)
//
// A lat-long of RGB floats becomes the six faces of a cube.
//   remap linear             cv::remap, INTER_LINEAR, coordinate maps given, output allocated before
//   remap linear with maps   the same with the maps made each time (cv::parallel_for_, atan2 and asin)
//   remap Lanczos4           cv::remap, INTER_LANCZOS4, maps given
//   resize area              cv::resize, INTER_AREA, of the source by the ratio of the heights: no change of layout
// Seconds of the wall's clock, and of the processor's, which other programs at work disturb less.
// Ours are whole calls: coordinates, aprons, prefilter and the mean's correction; the output's memory is used
// again, as remap's is.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <string>
#include <vector>

#include "envconv.h"

namespace {

using namespace envconv;

struct Rival {
  std::string name;
  std::function<void()> run;
  std::vector<double> seconds, cpu;
  static double median(std::vector<double>& values) {
    std::sort(values.begin(), values.end());
    return values[values.size() / 2];
  }
};

double cpu_seconds() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

// Where the texels of a cube's face lie in a lat-long of the given size, in texels; row by row on all cores.
void make_maps(const Layout& cube, int face, int size, int height, cv::Mat& x, cv::Mat& y) {
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
        to_x[i] = (0.5f + 0.5f * longitude * inverse_pi) * width - 0.5f;
        to_y[i] = (0.5f - latitude * inverse_pi) * static_cast<float>(height) - 0.5f;
      }
    }
  });
}

EnvImage noise(int height) {
  EnvImage image;
  image.layout = find_layout("latlong");
  image.placement = image.layout->info().placement;
  image.channels = Channels::standard(3);
  Image pixels(2 * height, height, 3);
  std::minstd_rand random(7);
  for (std::size_t i = 0; i < pixels.value_count(); ++i)
    pixels.data()[i] = 0.25f + static_cast<float>(random() % 1024) / 2048.0f;
  image.faces.push_back(std::move(pixels));
  return image;
}

void run(int height, int size, int runs, const std::string& only) {
  const EnvImage source = noise(height);
  Image copy = source.faces[0].clone();
  const cv::Mat pixels(height, 2 * height, CV_32FC3, copy.data());
  const Layout& cube = *find_layout("cube");
  std::vector<cv::Mat> x(6), y(6), faces(6);
  for (int f = 0; f < 6; ++f) {
    make_maps(cube, f, size, height, x[static_cast<std::size_t>(f)], y[static_cast<std::size_t>(f)]);
    faces[static_cast<std::size_t>(f)].create(size, size, CV_32FC3);
  }
  const auto remap = [&](int interpolation) {
    for (std::size_t f = 0; f < 6; ++f) cv::remap(pixels, faces[f], x[f], y[f], interpolation, cv::BORDER_WRAP);
  };
  EnvImage last;
  const auto ours = [&](const char* filter) {
    ResampleOptions options;
    options.layout = &cube;
    options.height = size;
    options.filter = find_filter(filter);
    Result<EnvImage> result = resample(source, options, std::move(last));
    if (!result) std::exit(1);
    last = std::move(*result);
  };
  cv::Mat small;
  std::vector<Rival> rivals;
  rivals.push_back({"remap linear", [&] { remap(cv::INTER_LINEAR); }, {}, {}});
  rivals.push_back({"remap linear with maps",
                    [&] {
                      for (int f = 0; f < 6; ++f)
                        make_maps(cube, f, size, height, x[static_cast<std::size_t>(f)],
                                  y[static_cast<std::size_t>(f)]);
                      remap(cv::INTER_LINEAR);
                    },
                    {},
                    {}});
  rivals.push_back({"remap Lanczos4", [&] { remap(cv::INTER_LANCZOS4); }, {}, {}});
  rivals.push_back({"resize area",
                    [&] {
                      const int factor = std::max(1, height / (2 * size));
                      cv::resize(pixels, small, cv::Size(2 * height / factor, height / factor), 0, 0, cv::INTER_AREA);
                    },
                    {},
                    {}});
  rivals.push_back({"envconv bilinear", [&] { ours("bilinear"); }, {}, {}});
  rivals.push_back({"envconv bicubic", [&] { ours("bicubic"); }, {}, {}});
  rivals.push_back({"envconv auto", [&] { ours("auto"); }, {}, {}});
  if (!only.empty()) std::erase_if(rivals, [&](const Rival& r) { return r.name.find(only) == std::string::npos; });
  for (int i = 0; i <= runs; ++i)
    for (Rival& rival : rivals) {
      const auto start = std::chrono::steady_clock::now();
      const double cpu = cpu_seconds();
      rival.run();
      if (i == 0) continue;
      rival.seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
      rival.cpu.push_back(cpu_seconds() - cpu);
    }
  std::printf("latlong %dx%d to a cube of %d, median of %d\n", 2 * height, height, size, runs);
  for (Rival& rival : rivals) {
    const double median = Rival::median(rival.seconds);
    std::printf("  %-24s %8.4f s  %6.1f Mtexel/s  %8.4f s of processor", rival.name.c_str(), median,
                6e-6 * size * size / median, Rival::median(rival.cpu));
    if (only.empty())
      std::printf("   x %.2f remap, x %.2f remap with maps, time / resize %.2f",
                  Rival::median(rivals[0].seconds) / median, Rival::median(rivals[1].seconds) / median,
                  median / Rival::median(rivals[3].seconds));
    std::printf("\n");
  }
}

}  // namespace

int main(int argc, char** argv) {
  int runs = 5;
  std::string only;
  std::vector<int> sizes;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--runs" && i + 1 < argc)
      runs = std::max(1, std::atoi(argv[++i]));
    else if (word == "--only" && i + 1 < argc)
      only = argv[++i];
    else
      sizes.push_back(std::atoi(word.c_str()));
  }
  if (sizes.empty()) sizes = {2048, 1024, 4096, 256};
  for (std::size_t i = 0; i + 1 < sizes.size(); i += 2) run(sizes[i], sizes[i + 1], runs, only);
}
