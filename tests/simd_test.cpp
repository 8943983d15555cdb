// SPDX-License-Identifier: Apache-2.0
// The float kernels on every SIMD target of this processor: within each layout's max_error of the double reference, the
// same on all targets, and right at the ends of batches.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

// As in lane-inl.h: the targets that the layouts were compiled for.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_RVV | HWY_SSSE3 | HWY_AVX3_DL)
#include <hwy/highway.h>

#include "envconv.h"
#include "layout_cases.h"

namespace envconv {
namespace {

constexpr double width = 16384;  // LayoutInfo::max_error is in texels of a face so wide

std::vector<int64_t> targets() {
  hwy::SetSupportedTargetsForTest(0);  // undo a test's choice
  std::vector<int64_t> bits;
  const int64_t both = hwy::SupportedTargets() & HWY_TARGETS;
  for (int bit = 0; bit < 63; ++bit)
    if (both & (int64_t{1} << bit)) bits.push_back(int64_t{1} << bit);
  return bits;
}
// Chooses a target for as long as it lives.
struct UseTarget {
  explicit UseTarget(int64_t target) { hwy::SetSupportedTargetsForTest(target); }
  ~UseTarget() { hwy::SetSupportedTargetsForTest(0); }
};

std::size_t padded(std::size_t n) { return (n + batch_padding - 1) / batch_padding * batch_padding; }

// Two or three arrays that belong together.
struct Batch {
  std::vector<float> a, b, c;
  explicit Batch(std::size_t n) : a(padded(n)), b(padded(n)), c(padded(n)) {}
};

Batch directions_on(const Layout& layout, int64_t target, int face, const Batch& points, std::size_t n) {
  const UseTarget use(target);
  Batch out(n);
  layout.directions(face, n, points.a.data(), points.b.data(), out.a.data(), out.b.data(), out.c.data());
  return out;
}
Batch locations_on(const Layout& layout, int64_t target, const Batch& d, std::size_t n) {
  const UseTarget use(target);
  Batch out(n);
  layout.locations(n, d.a.data(), d.b.data(), d.c.data(), out.a.data(), out.b.data(), out.c.data());
  return out;
}

// Owned random points of a face, and its corners, edges and middles.
Batch face_points(const Layout& layout, int face, std::size_t count, std::size_t& n) {
  Batch points(count + 81);
  test::RandomDirections random(100 + face);
  n = 0;
  const auto add = [&](double u, double v) {
    // Owned, by a margin: a point beyond a rim has a direction, but nobody asks for it.
    const bool owned = layout.owns(face, u, v);
    if (owned) points.a[n] = static_cast<float>(u), points.b[n] = static_cast<float>(v), ++n;
  };
  for (int j = 0; j <= 8; ++j)
    for (int i = 0; i <= 8; ++i) add(i / 8.0, j / 8.0);
  while (n < count) add(random.uniform(), random.uniform());
  return points;
}

// Directions of any length, all finite and representable.
Batch many_directions(std::size_t& n) {
  std::vector<Vec3> all = test::adversarial_directions<float>();
  test::RandomDirections random(200);
  for (int i = 0; i < 100000; ++i) all.push_back(random());
  for (int i = 0; i < 20000; ++i) all.push_back(std::pow(10.0, 12 * random.uniform() - 6) * random());
  for (int i = 0; i < 20000; ++i) {  // near an axis, where small differences cancel
    Vec3 d = 0.001 * random();
    (i % 3 == 0 ? d.x : i % 3 == 1 ? d.y : d.z) = i % 2 ? 1 : -1;
    all.push_back(d);
  }
  n = all.size();
  Batch batch(n);
  for (std::size_t i = 0; i < n; ++i)
    batch.a[i] = static_cast<float>(all[i].x), batch.b[i] = static_cast<float>(all[i].y),
    batch.c[i] = static_cast<float>(all[i].z);
  for (std::size_t i = n; i < batch.a.size(); ++i) batch.c[i] = 1;
  return batch;
}

class Simd : public testing::TestWithParam<const Layout*> {
 protected:
  const Layout& layout() const { return *GetParam(); }
};

// Error of a direction, in texels: the angle to the exact one, by the larger of the mean texel and the texel there
// (stretched texels forgive a large angle: that of the same step of u).
TEST_P(Simd, DirectionsAreWithinMaxError) {
  const double mean = test::mean_texel(layout(), width);
  double worst = 0;
  std::string where;
  for (int face = 0; face < layout().face_count(); ++face) {
    std::size_t n;
    const Batch points = face_points(layout(), face, 5000, n);
    std::vector<DirectionJet> exact(n);
    for (std::size_t i = 0; i < n; ++i) exact[i] = layout().direction_jet(face, points.a[i], points.b[i]);
    const double height = width / layout().info().faces[0].aspect * layout().info().faces[face].scale;
    for (const int64_t target : targets()) {
      const Batch d = directions_on(layout(), target, face, points, n);
      for (std::size_t i = 0; i < n; ++i) {
        const Vec3 got{d.a[i], d.b[i], d.c[i]};
        ASSERT_NEAR(length(got), 1, 4e-7)
            << hwy::TargetName(target) << " face " << face << ' ' << points.a[i] << ' ' << points.b[i];
        const double local =
            std::max(length(exact[i].du) / (height * layout().info().faces[face].aspect), length(exact[i].dv) / height);
        const double error = angle_between(got, exact[i].d) / (std::isfinite(local) ? std::max(mean, local) : mean);
        if (!(error <= worst)) {
          worst = error;
          where = std::string(hwy::TargetName(target)) + " face " + std::to_string(face) + " at " +
                  std::to_string(points.a[i]) + ", " + std::to_string(points.b[i]);
        }
      }
    }
  }
  RecordProperty("texels", std::to_string(worst));
  std::printf("%s: directions, worst error %.5f texel, %s\n", std::string(layout().name()).c_str(), worst,
              where.c_str());
  EXPECT_LE(worst, layout().info().max_error) << where;
}

// Error of a place, in texels: its distance on the face, or its angle by the larger of the mean texel and the texel
// there, whichever is less: at a pole any u will do, on a seam either face will, and at a rim the rounding of u itself
// is an angle of many mean texels.
TEST_P(Simd, LocationsAreWithinMaxError) {
  const double mean = test::mean_texel(layout(), width);
  std::size_t n;
  const Batch d = many_directions(n);
  std::vector<Location> exact(n);
  for (std::size_t i = 0; i < n; ++i) exact[i] = layout().locate({d.a[i], d.b[i], d.c[i]});
  double worst = 0;
  std::string where;
  for (const int64_t target : targets()) {
    const Batch at = locations_on(layout(), target, d, n);
    for (std::size_t i = 0; i < n; ++i) {
      const int face = static_cast<int>(at.a[i]);
      char direction[100];
      std::snprintf(direction, sizeof direction, "%s (%.9g, %.9g, %.9g)", hwy::TargetName(target), d.a[i], d.b[i],
                    d.c[i]);
      ASSERT_TRUE(face == at.a[i] && face >= 0 && face < layout().face_count()) << direction << ' ' << at.a[i];
      ASSERT_TRUE(at.b[i] >= 0 && at.b[i] <= 1 && at.c[i] >= 0 && at.c[i] <= 1) << direction;
      const Face& rectangle = layout().info().faces[face];
      const double height = width / layout().info().faces[0].aspect * rectangle.scale;
      const DirectionJet got = layout().direction_jet(face, at.b[i], at.c[i]);
      const double local = std::max(length(got.du) / (height * rectangle.aspect), length(got.dv) / height);
      double error = angle_between(got.d, {d.a[i], d.b[i], d.c[i]}) / std::max(mean, local);
      if (face == exact[i].face)
        error = std::min(
            error, std::hypot((at.b[i] - exact[i].u) * height * rectangle.aspect, (at.c[i] - exact[i].v) * height));
      if (!(error <= worst)) worst = error, where = direction;
    }
  }
  RecordProperty("texels", std::to_string(worst));
  std::printf("%s: locations, worst error %.5f texel, %s\n", std::string(layout().name()).c_str(), worst,
              where.c_str());
  EXPECT_LE(worst, layout().info().max_error) << where;
}

// No multiply-add and polynomials of our own: all processors compute the same.
TEST_P(Simd, TargetsAgreeToTheBit) {
  const std::vector<int64_t> all = targets();
  ASSERT_GE(all.size(), 2u) << "every processor has a target of its own and the scalar one";
  std::size_t n;
  const Batch d = many_directions(n);
  const Batch reference = locations_on(layout(), all[0], d, n);
  for (const int64_t target : all) {
    const Batch at = locations_on(layout(), target, d, n);
    for (std::size_t i = 0; i < n; ++i)
      ASSERT_TRUE(at.a[i] == reference.a[i] && at.b[i] == reference.b[i] && at.c[i] == reference.c[i])
          << hwy::TargetName(target) << " (" << d.a[i] << ", " << d.b[i] << ", " << d.c[i] << "): " << at.a[i] << ' '
          << at.b[i] << ' ' << at.c[i] << " but " << hwy::TargetName(all[0]) << ": " << reference.a[i] << ' '
          << reference.b[i] << ' ' << reference.c[i];
  }
  for (int face = 0; face < layout().face_count(); ++face) {
    const Batch points = face_points(layout(), face, 2000, n);
    const Batch one = directions_on(layout(), all[0], face, points, n);
    for (const int64_t target : all) {
      const Batch other = directions_on(layout(), target, face, points, n);
      for (std::size_t i = 0; i < n; ++i)
        ASSERT_TRUE(one.a[i] == other.a[i] && one.b[i] == other.b[i] && one.c[i] == other.c[i])
            << hwy::TargetName(target) << " face " << face << ' ' << points.a[i] << ' ' << points.b[i];
    }
  }
}

// Any number of points; nothing beyond the padding is touched, and what lies in the padding does not matter.
TEST_P(Simd, BatchesOfAnySize) {
  std::size_t many;
  const Batch d = many_directions(many), points = face_points(layout(), 0, 100, many);
  constexpr float canary = 12345;
  for (const int64_t target : targets()) {
    const Batch all_places = locations_on(layout(), target, d, 100),
                all = directions_on(layout(), target, 0, points, 100);
    const UseTarget use(target);
    for (const std::size_t n : {0, 1, 2, 3, 5, 15, 16, 17, 31, 33, 99}) {
      const std::size_t size = padded(n);
      // Inputs of exactly the promised size, with void in the padding.
      Batch in(n);
      for (auto* array : {&in.a, &in.b, &in.c}) std::fill(array->begin(), array->end(), NAN);
      const auto copy = [&](const Batch& from) {
        std::copy_n(from.a.begin(), n, in.a.begin());
        std::copy_n(from.b.begin(), n, in.b.begin());
        std::copy_n(from.c.begin(), n, in.c.begin());
      };
      const auto check = [&](const std::vector<float>& out, const std::vector<float>& expected, const char* what) {
        for (std::size_t i = 0; i < n; ++i) ASSERT_EQ(out[i], expected[i]) << what << ' ' << i << " of " << n;
        for (std::size_t i = size; i < out.size(); ++i) ASSERT_EQ(out[i], canary) << what << " beyond " << n;
      };
      std::vector<float> x(size + 32, canary), y = x, z = x;
      copy(d);
      layout().locations(n, in.a.data(), in.b.data(), in.c.data(), x.data(), y.data(), z.data());
      check(x, all_places.a, "face");
      check(y, all_places.b, "u");
      check(z, all_places.c, "v");
      x.assign(size + 32, canary), y = x, z = x;
      copy(points);
      layout().directions(0, n, in.a.data(), in.b.data(), x.data(), y.data(), z.data());
      check(x, all.a, "x");
      check(y, all.b, "y");
      check(z, all.c, "z");
    }
  }
}

// One picture, a wave under some noise (samples lie where they do to 4e-6 texels), on every processor, to rounding:
// with a kernel and a way of sampling of its own for each ratio of sizes.
TEST(SimdPictures, AgreeToAMillionth) {
  EnvImage source;
  source.layout = find_layout("latlong");
  test::RandomDirections random(300);
  for (const int channels : {3, 4}) {
    source.channels = Channels::standard(channels);
    Image face(128, 64, channels);
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 128; ++x)
        for (int c = 0; c < channels; ++c)
          face.at(x, y)[c] = static_cast<float>(0.5 + 0.4 * std::sin(0.1 * x + 0.1 * y + c) + 0.05 * random.uniform());
    source.faces.clear();
    source.faces.push_back(std::move(face));
    for (const Filter& filter : all_filters())
      for (const int height : {8, 24, 32, 64}) {
        ResampleOptions options;
        options.layout = find_layout("cube");
        options.height = height;
        options.filter = &filter;
        const std::vector<int64_t> all = targets();
        ASSERT_GE(all.size(), 2u);
        std::optional<EnvImage> reference;
        for (const int64_t target : all) {
          const UseTarget use(target);
          Result<EnvImage> out = resample(source, options);
          ASSERT_TRUE(out);
          if (!reference) {
            reference = std::move(*out);
            continue;
          }
          for (std::size_t f = 0; f < 6; ++f)
            for (int y = 0; y < height; ++y)
              for (int i = 0; i < height * channels; ++i)
                ASSERT_NEAR(out->faces[f].row(y)[i], reference->faces[f].row(y)[i], 1e-6f)
                    << hwy::TargetName(target) << ' ' << filter.name << ' ' << height << " face " << f << " row " << y;
        }
      }
  }
}

std::vector<const Layout*> layout_pointers() {
  std::vector<const Layout*> pointers;
  for (const Layout& layout : all_layouts()) pointers.push_back(&layout);
  return pointers;
}
INSTANTIATE_TEST_SUITE_P(, Simd, testing::ValuesIn(layout_pointers()),
                         [](const testing::TestParamInfo<const Layout*>& info) {
                           return test::test_name(*info.param);
                         });

}  // namespace
}  // namespace envconv
