// SPDX-License-Identifier: Apache-2.0
// Laws of resampling over every layout: constants, linear maps between every ordered pair, conservation, identity,
// thread count, seams, rims, and directions there and back.
#include "resample.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <random>

#include "analyze.h"
#include "layout_cases.h"
#include "painted_map.h"
#include "quadrature.h"
#include "sampler.h"
#include "solid_angle.h"

namespace envconv {
namespace {

using test::paint;
using Function = test::Radiance;

ResampleOptions to(const Layout& layout, int height) {
  ResampleOptions options;
  options.layout = &layout;
  options.height = height;
  options.placement = layout.info().placement;
  return options;
}

EnvImage convert(const EnvImage& source, const ResampleOptions& options) {
  Result<EnvImage> out = resample(source, options);
  EXPECT_TRUE(out.ok()) << (out.ok() ? "" : out.error().message);
  return std::move(*out);
}

// The height at which a layout has about so many texels.
int height_for(const Layout& layout, int texels) { return std::max(4, height_for_texels(layout, texels)); }

void directions(Vec3 d, float* p) { p[0] = float(d.x), p[1] = float(d.y), p[2] = float(d.z); }

class ResampleLaws : public testing::TestWithParam<const Layout*> {};
std::vector<const Layout*> registered() {
  std::vector<const Layout*> all;
  for (const Layout& layout : all_layouts()) all.push_back(&layout);
  return all;
}
INSTANTIATE_TEST_SUITE_P(All, ResampleLaws, testing::ValuesIn(registered()),
                         [](const auto& info) { return test::test_name(*info.param); });

TEST_P(ResampleLaws, ConstantStaysConstantInEveryTexel) {
  const EnvImage source = paint(*GetParam(), height_for(*GetParam(), 20000), 3,
                                [](Vec3, float* p) { p[0] = 0.25f, p[1] = 1.0f, p[2] = 1000.0f; });
  for (const Layout& target : test::targets_of(*GetParam())) {
    for (const int texels : {300, 20000}) {
      const EnvImage out = convert(source, to(target, height_for(target, texels)));
      for (const Image& face : out.faces)
        for (std::size_t i = 0; i < face.pixel_count(); ++i) {
          ASSERT_NEAR(face.data()[3 * i], 0.25f, 1e-6f) << target.name() << " texel " << i;
          ASSERT_NEAR(face.data()[3 * i + 1], 1.0f, 4e-6f) << target.name();
          ASSERT_NEAR(face.data()[3 * i + 2], 1000.0f, 4e-3f) << target.name();
        }
    }
  }
}

// a + b.d, to every other layout: the footprint's mean differs from the value at its centre by the footprint's second
// moment only, so the bound is a part of the texel's size, squared; the source's reconstruction adds as much.
TEST_P(ResampleLaws, LinearRadianceConvertsToEveryLayout) {
  const Layout& layout = *GetParam();
  const int height = height_for(layout, 40000);
  const auto f = [](Vec3 d, float* p) {
    p[0] = float(1.5 + 0.5 * d.x), p[1] = float(1.5 + 0.5 * d.y), p[2] = float(1.5 - 0.5 * d.z);
  };
  const EnvImage source = paint(layout, height, 3, f);
  for (const Layout& target : test::targets_of(layout)) {
    const EnvImage out = convert(source, to(target, height_for(target, 20000)));
    double worst = 0, sum = 0, weight = 0;
    for (int k = 0; k < target.face_count(); ++k) {
      const Image& face = out.faces[static_cast<std::size_t>(k)];
      for (int y = 0; y < face.height(); ++y)
        for (int x = 0; x < face.width(); ++x) {
          const double u = u_from_texel(x, face.width(), out.placement),
                       v = u_from_texel(y, face.height(), out.placement);
          if (!target.owns(k, u, v)) continue;
          const Mat3 world = transpose(layout_from_world(out));
          const DirectionJet jet = target.direction_jet(k, u, v);
          float truth[3];
          f(world * jet.d, truth);
          const double omega = length(cross(jet.du, jet.dv));
          for (int c = 0; c < 3; ++c) {
            const double error = std::abs(double(face.at(x, y)[c]) - double(truth[c]));
            worst = std::max(worst, error);
            sum += omega * error * error;
            weight += omega;
          }
        }
    }
    // Sphere maps stretch without bound at the rim, so there the worst texel tells nothing.
    const bool disc = target.info().domain == Domain::disc || layout.info().domain == Domain::disc;
    EXPECT_LT(std::sqrt(sum / weight), disc ? 4e-3 : 2.5e-4) << target.name();
    if (!disc) {
      EXPECT_LT(worst, 6e-3) << target.name();
    }
  }
}

TEST_P(ResampleLaws, MeanRadianceIsKept) {
  const Layout& layout = *GetParam();
  std::mt19937 random(5);
  std::uniform_real_distribution<float> uniform(0.2f, 2.0f);
  // Smooth structure, and noise on top, texel by texel.
  EnvImage source = paint(layout, height_for(layout, 15000), 1, [&](Vec3 d, float* p) {
    p[0] = float(1 + 0.8 * std::sin(5 * d.x + 3 * d.y)) * uniform(random);
  });
  const double mean = mean_radiance(source)[0];
  for (const Layout& target : test::targets_of(layout))
    for (const int texels : {1500, 40000}) {
      const EnvImage out = convert(source, to(target, height_for(target, texels)));
      EXPECT_NEAR(mean_radiance(out)[0] / mean, 1.0, 1e-4) << target.name() << " at " << texels;
    }
}

// Waves of a third of the source's Nyquist frequency are as good near its seams as elsewhere.
TEST(Resample, SeamsOfTheSourceCostNothing) {
  for (const char* name : {"cube", "tennis-ball", "diamond-12"}) {
    SCOPED_TRACE(name);
    const Layout& layout = *find_layout(name);
    const int height = height_for_texels(layout, 60000);
    const double limit = M_PI * std::sqrt(texel_count(layout, height) / figures(layout).sampling_requirement);
    std::mt19937 random(7);
    std::normal_distribution<double> normal;
    std::vector<Vec3> waves;
    for (int i = 0; i < 8; ++i)
      waves.push_back(0.3 * limit * normalize({normal(random), normal(random), normal(random)}));
    const auto value = [&](Vec3 d) {
      double sum = 0;
      for (const Vec3& k : waves) sum += std::cos(dot(k, d));
      return 1 + 0.1 * sum;
    };
    const EnvImage source = paint(layout, height, 3, [&](Vec3 d, float* p) { p[0] = p[1] = p[2] = float(value(d)); });
    const EnvImage out = convert(source, to(*find_layout("latlong"), 96));
    const Quadrature q = box_quadrature(6);
    const double near = 6.0 / height;
    double error[2]{}, area[2]{};  // elsewhere, and near seams
    for (int y = 8; y < 88; ++y)
      for (int x = 0; x < 192; ++x) {
        double sum = 0, total = 0;
        for (std::size_t j = 0; j < q.offset.size(); ++j)
          for (std::size_t i = 0; i < q.offset.size(); ++i) {
            const double v = u_from_texel(y + q.offset[j], 96, out.placement),
                         w = q.weight[i] * q.weight[j] * std::sin(M_PI * v);
            sum += w * value(out.layout->direction(0, u_from_texel(x + q.offset[i], 192, out.placement), v));
            total += w;
          }
        const Location at = layout.locate(
            out.layout->direction(0, u_from_texel(x, 192, out.placement), u_from_texel(y, 96, out.placement)));
        bool seam = false;
        for (const double a : {-near, near})
          for (const double b : {-near, near}) {
            const double u = at.u + a, v = at.v + b;
            seam = seam || u < 0 || u > 1 || v < 0 || v > 1 || !layout.owns(at.face, u, v);
          }
        const double off = double(out.faces[0].at(x, y)[0]) - sum / total;
        error[seam] += off * off, area[seam] += 1;
      }
    EXPECT_LT(std::sqrt(error[1] / area[1]), 1.25 * std::sqrt(error[0] / area[0]));
  }
}

// A sun of one texel, 5e4 times the rest, in places where its texel is a sliver, a corner or cut by a seam.
TEST_P(ResampleLaws, EnergyOfASunIsKept) {
  const Layout& layout = *GetParam();
  const int height = height_for(layout, 20000);
  for (const Vec3 place : {Vec3{0, 1, 0}, {1, 1, 1}, {0.3, 0.2, 0.9}, {0.01, 0, -1}}) {
    EnvImage source = paint(layout, height, 3, [](Vec3, float* p) { p[0] = p[1] = p[2] = 1.0f; });
    const Location at = layout.locate(layout_from_world(source) * place);
    Image& face = source.faces[static_cast<std::size_t>(at.face)];
    const int x = std::clamp(int(std::lround(texel_from_u(at.u, face.width(), source.placement))), 0, face.width() - 1);
    const int y =
        std::clamp(int(std::lround(texel_from_u(at.v, face.height(), source.placement))), 0, face.height() - 1);
    if (!layout.owns(at.face, u_from_texel(x, face.width(), source.placement),
                     u_from_texel(y, face.height(), source.placement)))
      continue;
    for (int c = 0; c < 3; ++c) face.at(x, y)[c] = 5e4f;
    const double mean = mean_radiance(source)[0];
    for (const char* name : {"latlong", "cube", "tennis-ball", "sphere-map"}) {
      const Layout& target = *find_layout(name);
      for (const int texels : {1500, 80000}) {
        const EnvImage out = convert(source, to(target, height_for(target, texels)));
        EXPECT_NEAR(mean_radiance(out)[0] / mean, 1.0, 1e-4)
            << name << " at " << texels << ", sun at " << place.x << " " << place.y << " " << place.z;
        float lowest = 1;
        for (const Image& f : out.faces)
          for (std::size_t i = 0; i < f.value_count(); ++i) lowest = std::min(lowest, f.data()[i]);
        EXPECT_GT(lowest, 0.999f) << name << ": a negative lobe around the sun";
      }
    }
  }
}

TEST_P(ResampleLaws, SameLayoutAndSizeIsACopyBitForBit) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(-1, 3);
  const EnvImage source = paint(*GetParam(), 24, 4, [&](Vec3, float* p) {
    for (int c = 0; c < 4; ++c) p[c] = uniform(random);
  });
  const EnvImage out = convert(source, to(*GetParam(), 24));
  for (std::size_t f = 0; f < source.faces.size(); ++f)
    EXPECT_EQ(0,
              std::memcmp(source.faces[f].data(), out.faces[f].data(), source.faces[f].value_count() * sizeof(float)));
}

TEST_P(ResampleLaws, ThreadCountDoesNotChangeABit) {
  std::mt19937 random(4);
  std::uniform_real_distribution<float> uniform(0, 1);
  EnvImage source = paint(*GetParam(), height_for(*GetParam(), 20000), 3, [&](Vec3, float* p) {
    for (int c = 0; c < 3; ++c) p[c] = uniform(random);
  });
  for (int k = 0; k < 20; ++k) source.faces[0].at(k, k % 3)[k % 3] = 1000.0f;  // highlights, on the edge too
  const char* other = GetParam()->name() == "cube" ? "latlong" : "cube";
  ResampleOptions options = to(*find_layout(other), 90);
  options.threads = 1;
  const EnvImage one = convert(source, options);
  for (const int threads : {2, 7}) {
    options.threads = threads;
    const EnvImage many = convert(source, options);
    for (std::size_t f = 0; f < one.faces.size(); ++f)
      ASSERT_EQ(0, std::memcmp(one.faces[f].data(), many.faces[f].data(), one.faces[f].value_count() * sizeof(float)));
  }
}

// A map of directions, 2048 wide, to each layout at 128 texels and back: the direction that a texel holds is within a
// quarter of a texel of the formula's at the 99th percentile.
TEST_P(ResampleLaws, DirectionsThereAndBack) {
  const Layout& layout = *GetParam();
  static const EnvImage panorama = paint(*find_layout("latlong"), 1024, 3, directions);
  const EnvImage there = convert(panorama, to(layout, 128));
  const Mat3 world_from_layout = transpose(layout_from_world(there));
  const auto percentile = [](std::vector<double> errors) {
    const std::size_t k = errors.size() * 99 / 100;
    std::nth_element(errors.begin(), errors.begin() + static_cast<std::ptrdiff_t>(k), errors.end());
    return errors[k];
  };
  std::vector<double> errors;
  for (int k = 0; k < layout.face_count(); ++k) {
    const Image& face = there.faces[static_cast<std::size_t>(k)];
    for (int y = 0; y < face.height(); ++y)
      for (int x = 0; x < face.width(); ++x) {
        const double u = u_from_texel(x, face.width(), there.placement),
                     v = u_from_texel(y, face.height(), there.placement);
        if (!layout.owns(k, u, v)) continue;
        const DirectionJet jet = layout.direction_jet(k, u, v);
        const float* p = face.at(x, y);
        const double side = std::sqrt(length(cross(jet.du, jet.dv)) / (double(face.width()) * face.height()));
        const double angle = angle_between({p[0], p[1], p[2]}, world_from_layout * jet.d);
        // Next to a singular point a texel's mean direction need not be near its centre's; its longer side is the
        // scale.
        const double longest = std::max(length(jet.du) / face.width(), length(jet.dv) / face.height());
        errors.push_back(angle / std::max(side, longest));
      }
  }
  EXPECT_LT(percentile(errors), 0.25) << "there";
  const EnvImage back = convert(there, to(*find_layout("latlong"), 256));
  errors.clear();
  // Judged in texels of the layout in between, where it was read.
  const Mat3 layout_from = layout_from_world(there);
  for (int y = 0; y < 256; ++y)
    for (int x = 0; x < 512; ++x) {
      const float* p = back.faces[0].at(x, y);
      const Vec3 d = find_layout("latlong")->direction(0, (x + 0.5) / 512, (y + 0.5) / 256);
      const Location at = layout.locate(layout_from * d);
      const DirectionJet jet = layout.direction_jet(at.face, at.u, at.v);
      const Image& face = there.faces[static_cast<std::size_t>(at.face)];
      errors.push_back(angle_between({p[0], p[1], p[2]}, d) /
                       std::max(length(jet.du) / face.width(), length(jet.dv) / face.height()));
    }
  EXPECT_LT(percentile(errors), 0.25) << "and back";
}

// Whatever the file has in texels that its layout does not own must not leak into the picture.
TEST_P(ResampleLaws, UnownedTexelsOfTheSourceAreNotRead) {
  const Layout& layout = *GetParam();
  if (layout.info().domain == Domain::square) return;
  EnvImage source = paint(layout, 96, 1, [](Vec3, float* p) { p[0] = 1.0f; });
  for (int k = 0; k < layout.face_count(); ++k) {
    Image& face = source.faces[static_cast<std::size_t>(k)];
    for (int y = 0; y < face.height(); ++y)
      for (int x = 0; x < face.width(); ++x)
        if (!layout.owns(k, (x + 0.5) / face.width(), (y + 0.5) / face.height())) face.at(x, y)[0] = 1e6f;
  }
  const EnvImage out = convert(source, to(*find_layout("cube"), 64));
  for (const Image& face : out.faces)
    for (std::size_t i = 0; i < face.value_count(); ++i) ASSERT_NEAR(face.data()[i], 1.0f, 1e-5f);
}

// Texels that the layout does not own hold their own direction's radiance, or the nearest rim's: never black.
TEST_P(ResampleLaws, UnownedTexelsOfTheOutputHoldTrueRadiance) {
  const Layout& layout = *GetParam();
  if (layout.info().domain == Domain::square) return;
  const EnvImage source = paint(*find_layout("cube"), 128, 3, [](Vec3 d, float* p) {
    p[0] = float(2 + d.x), p[1] = float(2 + d.y), p[2] = float(2 + d.z);
  });
  const EnvImage out = convert(source, to(layout, 64));
  const Mat3 world_from_layout = transpose(layout_from_world(out));
  int unowned = 0;
  for (int k = 0; k < layout.face_count(); ++k) {
    const Image& face = out.faces[static_cast<std::size_t>(k)];
    for (int y = 0; y < face.height(); ++y)
      for (int x = 0; x < face.width(); ++x) {
        double u = (x + 0.5) / face.width(), v = (y + 0.5) / face.height();
        if (layout.owns(k, u, v)) continue;
        ++unowned;
        if (layout.info().domain == Domain::disc) {
          const double a = 2 * u - 1, b = 2 * v - 1, r = std::hypot(a, b);
          u = 0.5 + 0.5 * a / r, v = 0.5 + 0.5 * b / r;
        }
        const Vec3 d = world_from_layout * layout.direction(k, u, v);
        const float* p = face.at(x, y);
        // The rim of a sphere map turns by many degrees within a texel.
        const double tolerance = layout.info().domain == Domain::disc ? 0.3 : 0.01;
        ASSERT_NEAR(p[0], 2 + d.x, tolerance) << k << " " << x << " " << y;
        ASSERT_NEAR(p[1], 2 + d.y, tolerance) << k << " " << x << " " << y;
        ASSERT_NEAR(p[2], 2 + d.z, tolerance) << k << " " << x << " " << y;
      }
  }
  EXPECT_GT(unowned, 0);
}

// Reading just this side and just that side of every face's edge must give the same radiance: a smooth map has no seam.
TEST_P(ResampleLaws, NoSeamInTheReconstruction) {
  const Layout& layout = *GetParam();
  const EnvImage source = paint(layout, height_for(layout, 50000), 1, [](Vec3 d, float* p) {
    p[0] = float(1 + 0.5 * std::cos(20 * d.x + 7 * d.y) * std::cos(15 * d.z));
  });
  for (const char* name : {"auto", "bilinear", "bicubic", "lanczos"}) {
    Result<Sampler> sampler = Sampler::make(source, *find_filter(name));
    ASSERT_TRUE(sampler.ok());
    const Mat3 world = transpose(layout_from_world(source));
    double worst = 0;
    for (int k = 0; k < layout.face_count(); ++k)
      for (int edge = 0; edge < 4; ++edge)
        for (int i = 0; i < 50; ++i) {
          const double t = (i + 0.5) / 50, in = 1e-5, out = -1e-5;
          const auto at = [&](double depth) {
            const double s = edge % 2 ? 1 - depth : depth;
            return world * (edge < 2 ? layout.direction(k, s, t) : layout.direction(k, t, s));
          };
          float a, b;
          sampler->radiance(at(in), &a);
          sampler->radiance(at(out), &b);
          worst = std::max(worst, std::abs(double(a) - double(b)));
        }
    // The sphere map's rim is one direction for all its texels: no finite grid follows it.
    EXPECT_LT(worst, layout.info().domain == Domain::disc ? 0.1 : 8e-3) << name;
  }
}

TEST(Resample, RotationAndFramesPutThingsWhereTheyBelong) {
  const Layout& latlong = *find_layout("latlong");
  const EnvImage source = paint(latlong, 128, 3, directions);
  const auto look = [](const EnvImage& image, Vec3 layout_direction) {
    const Location at = image.layout->locate(layout_direction);
    const Image& face = image.faces[static_cast<std::size_t>(at.face)];
    const float* p = face.at(std::min(int(at.u * face.width()), face.width() - 1),
                             std::min(int(at.v * face.height()), face.height() - 1));
    return Vec3{p[0], p[1], p[2]};
  };
  // A yaw of 90 degrees takes what was forward to the right, a pitch what was up to the front, a roll right to the top.
  struct Case {
    Rotation rotation;
    Vec3 from, to;
  };
  for (const Case& c : {Case{{90, 0, 0}, {0, 0, 1}, {1, 0, 0}}, Case{{0, 90, 0}, {0, 1, 0}, {0, 0, 1}},
                        Case{{0, 0, 90}, {1, 0, 0}, {0, 1, 0}}, Case{{90, 90, 0}, {0, 1, 0}, {1, 0, 0}}}) {
    ResampleOptions options = to(*find_layout("cube"), 64);
    options.rotation = c.rotation;
    EXPECT_LT(angle_between(look(convert(source, options), c.to), c.from), 0.05);
  }
  // In a frame, the layout's own formula on the consumer's axes finds the world's radiance.
  for (const Frame& frame : all_frames()) {
    ResampleOptions options = to(*find_layout("cube"), 64);
    options.consumer_from_world = frame.consumer_from_world;
    const EnvImage out = convert(source, options);
    for (const Vec3 d : {Vec3{1, 0.1, 0.2}, {-0.3, 1, 0.1}, {0.2, -0.2, -1}})
      EXPECT_LT(angle_between(look(out, frame.consumer_from_world * d), d), 0.05) << frame.name;
    // And back: reading in the frame undoes it.
    const EnvImage back = convert(out, to(latlong, 64));
    for (const Vec3 d : {Vec3{1, 0.1, 0.2}, {-0.3, 1, 0.1}, {0.2, -0.2, -1}})
      EXPECT_LT(angle_between(look(back, d), d), 0.05) << frame.name;
  }
}

// Shrinking: detail too fine for the output must not alias.  The truth is the mean of many points over each footprint.
TEST(Resample, ShrinkingDoesNotAlias) {
  const Layout& latlong = *find_layout("latlong");
  const auto f = [](Vec3 d) { return 1 + std::cos(300 * d.y) * std::cos(200 * d.x); };
  const EnvImage source = paint(latlong, 512, 1, [&](Vec3 d, float* p) { p[0] = float(f(d)); });
  for (const char* name : {"cube", "octahedral", "isocube", "tennis-ball", "healpix", "latlong"}) {
    const Layout& target = *find_layout(name);
    const EnvImage out = convert(source, to(target, height_for(target, 6 * 16 * 16)));
    double sum = 0, weight = 0, contrast = 0;
    for (int k = 0; k < target.face_count(); ++k) {
      const Image& face = out.faces[static_cast<std::size_t>(k)];
      for (int y = 0; y < face.height(); ++y)
        for (int x = 0; x < face.width(); ++x) {
          constexpr int n = 48;
          double mean = 0, total = 0;
          for (int j = 0; j < n; ++j)
            for (int i = 0; i < n; ++i) {
              const DirectionJet jet =
                  target.direction_jet(k, (x + (i + 0.5) / n) / face.width(), (y + (j + 0.5) / n) / face.height());
              const double omega = length(cross(jet.du, jet.dv));
              mean += omega * f(jet.d), total += omega;
            }
          const double error = double(face.at(x, y)[0]) - mean / total;
          sum += total * error * error, contrast += total * std::pow(mean / total - 1, 2), weight += total;
        }
    }
    // One sample a texel would be off by 0.5.
    EXPECT_LT(std::sqrt(sum / weight), 0.012)
        << name << " (contrast of the truth " << std::sqrt(contrast / weight) << ")";
  }
}

// Growing eightfold a band-limited picture: no blocks, no ringing; the sampling theorem's answer within half a percent.
TEST(Resample, GrowingIsSmooth) {
  const auto f = [](Vec3 d, float* p) { p[0] = float(1 + 0.5 * std::cos(12 * d.x + 9 * d.y - 7 * d.z)); };
  const EnvImage source = paint(*find_layout("latlong"), 64, 1, f);
  const EnvImage out = convert(source, to(*find_layout("cube"), 256));
  for (int k = 0; k < 6; ++k)
    for (int y = 0; y < 256; y += 3)
      for (int x = 0; x < 256; x += 3) {
        float truth;
        f(out.layout->direction(k, (x + 0.5) / 256, (y + 0.5) / 256), &truth);
        ASSERT_NEAR(out.faces[static_cast<std::size_t>(k)].at(x, y)[0], truth, 5e-3f);
      }
}

// Labels survive: the nearest filter invents no values.
TEST(Resample, NearestTakesTexelsAsTheyAre) {
  const EnvImage source =
      paint(*find_layout("latlong"), 40, 1, [](Vec3 d, float* p) { p[0] = d.x + d.y > 0.3 ? 7.0f : 2.0f; });
  ResampleOptions options = to(*find_layout("cube"), 50);
  options.filter = find_filter("nearest");
  const EnvImage out = convert(source, options);
  for (const Image& face : out.faces)
    for (std::size_t i = 0; i < face.value_count(); ++i) ASSERT_TRUE(face.data()[i] == 7.0f || face.data()[i] == 2.0f);
}

TEST(Resample, ManyChannelsAndNone) {
  const EnvImage source = paint(*find_layout("latlong"), 32, 6, [](Vec3 d, float* p) {
    for (int c = 0; c < 6; ++c) p[c] = float(c + 1 + 0.5 * d.x);
  });
  const EnvImage out = convert(source, to(*find_layout("cube"), 16));
  ASSERT_EQ(out.channels.count(), 6);
  for (int c = 0; c < 6; ++c) EXPECT_NEAR(out.faces[0].at(8, 8)[c], c + 1.5, 0.01);
  EnvImage nothing;
  nothing.layout = find_layout("cube");
  EXPECT_FALSE(resample(nothing, to(*find_layout("cube"), 16)).ok());
}

TEST(Resample, AUsedUpSourceGivesTheSameBytes) {
  for (const Layout& layout : all_layouts()) {
    SCOPED_TRACE(layout.name());
    EnvImage source = paint(layout, 24, 3, [](Vec3 d, float* p) {
      for (int c = 0; c < 3; ++c) p[c] = c == 0 && d.y > 0.99 ? 900.0f : float(2 + d.x + c * d.z);
    });
    const ResampleOptions options = to(*find_layout("equi-angular-cube"), 16);
    const EnvImage kept = convert(source, options);
    const Result<EnvImage> moved = resample(std::move(source), options);
    ASSERT_TRUE(moved.ok());
    for (std::size_t f = 0; f < kept.faces.size(); ++f)
      ASSERT_EQ(0, std::memcmp(kept.faces[f].data(), moved->faces[f].data(), kept.faces[f].value_count() * 4));
  }
}

TEST(Resample, WhereNothingChangesAUsedUpSourceIsMoved) {
  EnvImage source = paint(*find_layout("cube"), 16, 3, directions);
  const float* texels = source.faces[2].data();
  const Result<EnvImage> moved = resample(std::move(source), to(*find_layout("cube"), 16));
  ASSERT_TRUE(moved.ok());
  EXPECT_EQ(moved->faces[2].data(), texels);
  EXPECT_TRUE(source.faces.empty());
}

TEST(Resample, ProgressCanStopTheWork) {
  const EnvImage source = paint(*find_layout("latlong"), 64, 3, directions);
  ResampleOptions options = to(*find_layout("cube"), 256);
  options.progress = [](double share) { return share < 0.3; };
  EXPECT_FALSE(resample(source, options).ok());
}

}  // namespace
}  // namespace envconv
