// SPDX-License-Identifier: Apache-2.0
// Laws of MIP levels, for every layout and every filter.
#include "mip.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>

#include "layout_cases.h"
#include "solid_angle.h"

namespace envconv {
namespace {

using Paint = std::function<void(int face, int i, int j, Vec3 d, float* texel)>;

EnvImage painted(const Layout& layout, int height, const Paint& paint, int channels = 1) {
  EnvImage image;
  image.layout = &layout;
  image.placement = layout.info().placement;
  image.channels = Channels::standard(channels);
  for (int f = 0; f < layout.face_count(); ++f) {
    const Size size = face_size(layout, f, height);
    Image& face = image.faces.emplace_back(size.width, size.height, channels);
    for (int j = 0; j < size.height; ++j)
      for (int i = 0; i < size.width; ++i)
        paint(f, i, j,
              layout.direction(f, u_from_texel(i, size.width, image.placement),
                               u_from_texel(j, size.height, image.placement)),
              face.at(i, j));
  }
  return image;
}

Location texel_at(const EnvImage& image, Vec3 d, int& i, int& j) {
  const Location at = image.layout->locate(d);
  const Image& face = image.faces[static_cast<std::size_t>(at.face)];
  i = std::clamp(static_cast<int>(std::lround(texel_from_u(at.u, face.width(), image.placement))), 0, face.width() - 1);
  j = std::clamp(static_cast<int>(std::lround(texel_from_u(at.v, face.height(), image.placement))), 0,
                 face.height() - 1);
  return at;
}

// Where suns hurt: poles, a corner and an edge of the cube, and on the first face's own seam.
std::vector<Vec3> sun_places(const Layout& layout) {
  std::vector<Vec3> places{{0, 1, 0}, {0, -1, 0}, {0, 0, -1}, {1, 1, 1}, {-1, 1, -1}, {1, 0, 1}, {0.3, -0.8, 0.5}};
  // On the row through the middle of the first face, where its own part ends.
  double in = 0.5, out = 1.0;
  if (!layout.owns(0, out, 0.5)) {
    for (int step = 0; step < 50; ++step) (layout.owns(0, 0.5 * (in + out), 0.5) ? in : out) = 0.5 * (in + out);
  }
  places.push_back(layout.direction(0, layout.owns(0, 1.0, 0.5) ? 1.0 : in, 0.5));
  return places;
}

EnvImage noise_with_suns(const Layout& layout, int height, double sun) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> brightness(0.0f, 1.0f);
  EnvImage image = painted(layout, height, [&](int, int, int, Vec3, float* t) { *t = brightness(random); });
  for (const Vec3& d : sun_places(layout)) {
    int i, j;
    const Location at = texel_at(image, d, i, j);
    image.faces[static_cast<std::size_t>(at.face)].at(i, j)[0] = static_cast<float>(sun);
  }
  return image;
}

std::vector<EnvImage> chain(const EnvImage& image, const MipFilter& filter, int threads = 0) {
  MipOptions options;
  options.filter = &filter;
  options.threads = threads;
  Result<std::vector<EnvImage>> levels = make_mips(image, options);
  EXPECT_TRUE(levels) << levels.error().message;
  return levels ? std::move(*levels) : std::vector<EnvImage>{};
}

class MipLaws : public testing::TestWithParam<const Layout*> {
 protected:
  const Layout& layout() const { return *GetParam(); }
  // So that layouts of many faces take no longer than others.
  int tall(int height) const { return layout().face_count() > 8 ? height / 2 : height; }
};

TEST_P(MipLaws, SizesHalveDownToOneTexel) {
  for (const int height : {16, 13, 1}) {
    const EnvImage image = painted(layout(), height, [](int, int, int, Vec3, float* t) { *t = 1; });
    const auto levels = chain(image, all_mip_filters().front());
    ASSERT_EQ(static_cast<int>(levels.size()) + 1, level_count(layout(), height));
    for (std::size_t k = 0; k < levels.size(); ++k) {
      const EnvImage& above = k ? levels[k - 1] : image;
      bool shrinks = false;
      for (std::size_t f = 0; f < image.faces.size(); ++f) {
        EXPECT_EQ(levels[k].faces[f].width(), std::max(1, above.faces[f].width() / 2));
        EXPECT_EQ(levels[k].faces[f].height(), std::max(1, above.faces[f].height() / 2));
        shrinks = shrinks || above.faces[f].width() > 1 || above.faces[f].height() > 1;
      }
      EXPECT_TRUE(shrinks);
      EXPECT_EQ(levels[k].layout, image.layout);
      EXPECT_EQ(levels[k].placement, image.placement);
    }
    const EnvImage& last = levels.empty() ? image : levels.back();
    for (const Image& face : last.faces) EXPECT_EQ(face.pixel_count(), 1u);
  }
}

TEST_P(MipLaws, AConstantStaysConstant) {
  // What stands in texels that own nothing may not show.
  for (const int height : {tall(16), 11}) {
    const EnvImage image = painted(layout(), height, [&](int f, int i, int j, Vec3, float* t) {
      const Size size = face_size(layout(), f, height);
      double owned;
      texel_solid_angles(layout(), f, size, layout().info().placement, i, j, 1, 1, &owned);
      *t = owned > 0 ? 0.3f : -1000.0f;
    });
    for (const MipFilter& filter : all_mip_filters())
      for (const EnvImage& level : chain(image, filter))
        for (const Image& face : level.faces)
          for (std::size_t n = 0; n < face.value_count(); ++n) ASSERT_NEAR(face.data()[n], 0.3f, 3e-7f) << filter.name;
  }
}

TEST_P(MipLaws, TheMeanOverTheSphereIsKept) {
  for (const int height : {tall(16), tall(26)}) {
    const EnvImage image = noise_with_suns(layout(), height, 5e4);
    const double before = mean_radiance(image)[0];
    for (const MipFilter& filter : all_mip_filters())
      for (const EnvImage& level : chain(image, filter))
        EXPECT_NEAR(mean_radiance(level)[0] / before, 1, 1e-5)
            << filter.name << ", " << height << " to " << level.height();
  }
}

TEST_P(MipLaws, ALinearFieldKeepsItsValues) {
  // L = 2 + x + y/2 - z/4: its mean is 2, and a texel has its value near the texel's direction.
  const EnvImage image = painted(
      layout(), 32, [](int, int, int, Vec3 d, float* t) { *t = static_cast<float>(2 + d.x + 0.5 * d.y - 0.25 * d.z); });
  const auto mean0 = mean_radiance(image)[0];
  for (const MipFilter& filter : all_mip_filters()) {
    const auto levels = chain(image, filter);
    for (const EnvImage& level : levels) EXPECT_NEAR(mean_radiance(level)[0], mean0, 2e-5) << filter.name;
    const EnvImage& second = levels[1];
    for (int f = 0; f < layout().face_count(); ++f) {
      const Image& face = second.faces[static_cast<std::size_t>(f)];
      for (int j = 0; j < face.height(); ++j)
        for (int i = 0; i < face.width(); ++i) {
          double u = u_from_texel(i, face.width(), second.placement),
                 v = u_from_texel(j, face.height(), second.placement);
          if (layout().info().domain == Domain::disc && !layout().owns(f, u, v)) continue;
          const Vec3 d = layout().direction(f, u, v);
          // No further off than the texel is wide, and half of it for what its footprint's middle is away.
          const DirectionJet jet = layout().direction_jet(f, u, v);
          const double side = std::max({length(jet.du) / face.width(), length(jet.dv) / face.height(), 0.0});
          EXPECT_NEAR(face.at(i, j)[0], 2 + d.x + 0.5 * d.y - 0.25 * d.z, std::min(1.5, 0.75 * side + 0.05))
              << filter.name << " face " << f << " " << i << "," << j;
        }
    }
  }
}

// The integral over the footprint, by midpoints of a grid that level 0's bounds are part of.
TEST_P(MipLaws, BoxIsTheIntegralOverTheFootprint) {
  const int height = 7;
  std::mt19937 random(3);
  std::uniform_real_distribution<float> brightness(1.0f, 2.0f);
  const EnvImage image = painted(layout(), height, [&](int, int, int, Vec3, float* t) { *t = brightness(random); });
  const auto levels = chain(image, all_mip_filters().front());
  for (const EnvImage& level : levels)
    for (int f = 0; f < std::min(2, layout().face_count()); ++f) {
      const Image &face = level.faces[static_cast<std::size_t>(f)], &source = image.faces[static_cast<std::size_t>(f)];
      for (int j = 0; j < face.height(); ++j)
        for (int i = 0; i < face.width(); ++i) {
          const auto columns = texel_bounds(face.width(), image.placement, i, 1);
          const auto rows = texel_bounds(face.height(), image.placement, j, 1);
          const int n = 126;
          double sum = 0, total = 0;
          for (int y = 0; y < n; ++y)
            for (int x = 0; x < n; ++x) {
              const double u = columns[0] + (x + 0.5) / n * (columns[1] - columns[0]);
              const double v = rows[0] + (y + 0.5) / n * (rows[1] - rows[0]);
              if (!layout().owns(f, u, v)) continue;
              const DirectionJet jet = layout().direction_jet(f, u, v);
              const double w = length(cross(jet.du, jet.dv));
              const int sx =
                  std::clamp(static_cast<int>(std::floor(texel_from_u(u, source.width(), image.placement) + 0.5)), 0,
                             source.width() - 1);
              const int sy =
                  std::clamp(static_cast<int>(std::floor(texel_from_u(v, source.height(), image.placement) + 0.5)), 0,
                             source.height() - 1);
              sum += w * static_cast<double>(source.at(sx, sy)[0]);
              total += w;
            }
          // Rectangles whose owned part is a few samples only are not measured well enough by them.
          const double share = total / n / n * (columns[1] - columns[0]) * (rows[1] - rows[0]) /
                               texel_solid_angle(layout(), f, i, j, {face.width(), face.height()}, image.placement);
          if (total > 0 && std::abs(share - 1) < 0.02) {
            EXPECT_NEAR(face.at(i, j)[0], sum / total, 0.01) << f << ": " << i << "," << j << " of " << face.width();
          }
        }
    }
}

TEST_P(MipLaws, NothingFallsBelowZero) {
  const EnvImage image = noise_with_suns(layout(), tall(16), 5e4);
  for (const MipFilter& filter : all_mip_filters())
    for (const EnvImage& level : chain(image, filter))
      for (const Image& face : level.faces)
        for (std::size_t n = 0; n < face.value_count(); ++n) ASSERT_GE(face.data()[n], 0.0f) << filter.name;
}

TEST_P(MipLaws, ThreadsDoNotChangeABit) {
  const EnvImage image = noise_with_suns(layout(), tall(18), 5e4);
  for (const MipFilter& filter : all_mip_filters()) {
    const auto one = chain(image, filter, 1), many = chain(image, filter, 0);
    for (std::size_t k = 0; k < one.size(); ++k)
      for (std::size_t f = 0; f < one[k].faces.size(); ++f)
        ASSERT_TRUE(std::equal(one[k].faces[f].data(), one[k].faces[f].data() + one[k].faces[f].value_count(),
                               many[k].faces[f].data()))
            << filter.name;
  }
}

INSTANTIATE_TEST_SUITE_P(All, MipLaws, testing::ValuesIn([] {
                           std::vector<const Layout*> list;
                           for (const Layout& layout : all_layouts()) list.push_back(&layout);
                           return list;
                         }()),
                         [](const auto& info) { return test::test_name(*info.param); });

// The filters' kernels are what their names say: even, 1 at the centre, 0 at the other whole numbers, and the sharper
// ones pass more of a wave of four texels of the level than the box does.
TEST(MipFilters, Kernels) {
  EXPECT_EQ(find_mip_filter("box")->kernel, nullptr);
  EXPECT_EQ(find_mip_filter("nonesuch"), nullptr);
  for (const char* name : {"triangle", "kaiser", "lanczos"}) {
    const MipFilter* filter = find_mip_filter(name);
    ASSERT_NE(filter, nullptr);
    EXPECT_DOUBLE_EQ(filter->kernel(0), 1);
    for (double t = 1; t < filter->radius; ++t) EXPECT_NEAR(filter->kernel(t), 0, 1e-12);
    for (double t = 0.1; t < filter->radius; t += 0.1) EXPECT_DOUBLE_EQ(filter->kernel(t), filter->kernel(-t));
  }
}

double wave_amplitude(const char* filter, double waves) {
  const Layout& layout = *find_layout("latlong");
  const EnvImage image = painted(layout, 128, [&](int, int, int, Vec3 d, float* t) {
    *t = static_cast<float>(1 + 0.5 * std::cos(waves * std::atan2(d.x, d.z)));
  });
  MipOptions options;
  options.filter = find_mip_filter(filter);
  const auto levels = make_mips(image, options);
  const EnvImage& level = (*levels)[2];  // 32 texels around
  const float* row = level.faces[0].row(level.height() / 2);
  return *std::max_element(row, row + level.faces[0].width()) - *std::min_element(row, row + level.faces[0].width());
}

TEST(MipFilters, SharpnessOfAWaveOfFourTexels) {
  const double box = wave_amplitude("box", 8), triangle = wave_amplitude("triangle", 8);
  const double kaiser = wave_amplitude("kaiser", 8), lanczos = wave_amplitude("lanczos", 8);
  EXPECT_LT(triangle, box);
  EXPECT_GT(kaiser, box);
  EXPECT_GT(lanczos, box);
  // And less of one that the level cannot hold (20 waves on 32 texels).
  EXPECT_LT(wave_amplitude("kaiser", 20), 0.75 * wave_amplitude("box", 20));
  EXPECT_LT(wave_amplitude("lanczos", 20), 0.75 * wave_amplitude("box", 20));
}

TEST(Mips, NoPixelsIsAnError) { EXPECT_FALSE(make_mips(EnvImage{}, {})); }

TEST(Mips, LevelsThatWereAskedFor) {
  const EnvImage image = painted(*find_layout("cube"), 16, [](int, int, int, Vec3, float* t) { *t = 1; });
  MipOptions options;
  options.levels = 3;
  EXPECT_EQ(make_mips(image, options)->size(), 2u);
  options.levels = 1;
  EXPECT_TRUE(make_mips(image, options)->empty());
  options.levels = 99;
  EXPECT_EQ(make_mips(image, options)->size(), 4u);
}

}  // namespace
}  // namespace envconv
