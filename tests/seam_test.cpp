// SPDX-License-Identifier: Apache-2.0
// Laws of seam methods and of the seam error, for every layout.
#include "seam.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <map>
#include <random>
#include <set>

#include "layout_cases.h"
#include "mip.h"
#include "recognize.h"
#include "resample.h"
#include "solid_angle.h"

namespace envconv {
namespace {

constexpr double sun = 5e4;

double smooth(Vec3 d) { return 1.5 + 0.5 * d.x + 0.3 * d.y + 0.3 * std::sin(6 * d.x) * std::cos(5 * d.y + 2 * d.z); }

EnvImage empty_map(const Layout& layout, int height, const Seam& seam) {
  EnvImage image;
  image.layout = &layout;
  image.placement = placement_for(layout, seam);
  image.channels = Channels::standard(1);
  for (int f = 0; f < layout.face_count(); ++f) {
    const Size size = face_size(layout, f, height);
    image.faces.emplace_back(size.width, size.height, 1);
  }
  return image;
}

template <class Value>
EnvImage painted(const Layout& layout, int height, const Seam& seam, const Value& value) {
  EnvImage image = empty_map(layout, height, seam);
  for (int f = 0; f < layout.face_count(); ++f) {
    Image& face = image.faces[static_cast<std::size_t>(f)];
    for (int j = 0; j < face.height(); ++j)
      for (int i = 0; i < face.width(); ++i)
        *face.at(i, j) = static_cast<float>(value(layout.direction(f, u_from_texel(i, face.width(), image.placement),
                                                                   u_from_texel(j, face.height(), image.placement))));
  }
  return image;
}

// Neighbours disagree everywhere, and one edge texel is a sun.
EnvImage noise(const Layout& layout, int height, const Seam& seam) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> brightness(0.0, 1.0);
  EnvImage image = painted(layout, height, seam, [&](Vec3) { return brightness(random); });
  *image.faces[0].at(image.faces[0].width() - 1, image.faces[0].height() / 2) = static_cast<float>(sun);
  return image;
}

std::vector<EnvImage> all_levels(EnvImage level0, const Seam& seam) {
  Result<std::vector<EnvImage>> made = make_mips(level0, {});
  EXPECT_TRUE(made);
  std::vector<EnvImage> levels = std::move(*made);
  levels.insert(levels.begin(), std::move(level0));
  for (EnvImage& level : levels) fix_seams(level, seam);
  return levels;
}

SeamError error_of(const EnvImage& level, const Seam& seam) {
  return seam_error(level, seam.gutter() ? with_gutters(level, seam.gutter()) : std::vector<Image>{}, seam.gutter());
}

// Layouts whose faces meet along whole edges, texel to texel.
bool faces_meet(const Layout& layout) {
  static const std::set<std::string_view> names{"cube",       "isocube",   "equi-angular-cube", "openexr-cube",
                                                "octahedral", "diamond-6", "diamond-8",         "diamond-10",
                                                "diamond-12", "diamond-30"};
  return names.contains(layout.name());
}

class SeamLaws : public testing::TestWithParam<const Layout*> {
 protected:
  const Layout& layout() const { return *GetParam(); }
  int tall(int height) const { return layout().face_count() > 8 ? height / 2 : height; }
};

struct Texel {
  Vec3 d;
  float value;
};

// Texels centred on faces' edges, as far as the layout owns them.
std::vector<Texel> on_edges(const EnvImage& image) {
  std::vector<Texel> texels;
  for (int f = 0; f < image.layout->face_count(); ++f) {
    const Image& face = image.faces[static_cast<std::size_t>(f)];
    for (int j = 0; j < face.height(); ++j)
      for (int i = 0; i < face.width(); ++i) {
        if (i > 0 && j > 0 && i < face.width() - 1 && j < face.height() - 1) continue;
        const double u = u_from_texel(i, face.width(), image.placement),
                     v = u_from_texel(j, face.height(), image.placement);
        if (image.layout->owns(f, u, v)) texels.push_back({image.layout->direction(f, u, v), *face.at(i, j)});
      }
  }
  return texels;
}

TEST_P(SeamLaws, StretchIsEqualWhereverTexelsMeet) {
  const Seam stretch{SeamMethod::stretch, 0};
  EXPECT_EQ(placement_for(layout(), stretch), Placement::inclusive);
  for (const EnvImage& level : all_levels(noise(layout(), tall(17), stretch), stretch)) {
    const std::vector<Texel> texels = on_edges(level);
    std::size_t meetings = 0;
    for (std::size_t a = 0; a < texels.size(); ++a)
      for (std::size_t b = a + 1; b < texels.size(); ++b) {
        if (length(texels[a].d - texels[b].d) > 1e-9) continue;
        ++meetings;
        EXPECT_EQ(std::memcmp(&texels[a].value, &texels[b].value, sizeof(float)), 0) << level.height();
      }
    if (faces_meet(layout()) && level.height() > 1) {
      EXPECT_GE(2 * meetings, texels.size());
    }
  }
}

TEST_P(SeamLaws, StretchLeavesNoSeamWhereFacesMeet) {
  if (!faces_meet(layout())) return;  // of the others no promise is made
  const Seam stretch{SeamMethod::stretch, 0};
  for (const EnvImage& level : all_levels(noise(layout(), tall(16), stretch), stretch))
    EXPECT_EQ(seam_error(level).largest, 0) << level.height();
}

TEST_P(SeamLaws, TheLastStretchedLevelIsTheMean) {
  const Seam stretch{SeamMethod::stretch, 0};
  const std::vector<EnvImage> levels = all_levels(noise(layout(), tall(16), stretch), stretch);
  const double mean = mean_radiance(levels[0])[0];
  for (const Image& face : levels.back().faces) {
    ASSERT_EQ(face.pixel_count(), 1u);
    EXPECT_NEAR(*face.at(0, 0) / mean, 1, 1e-5);
    EXPECT_EQ(*face.at(0, 0), *levels.back().faces[0].at(0, 0));
  }
}

TEST_P(SeamLaws, TheMeanIsKept) {
  for (const Seam seam : {Seam{SeamMethod::stretch, 0}, Seam{SeamMethod::average, 1}, Seam{SeamMethod::average, 3}}) {
    EnvImage image = noise(layout(), tall(16), seam);
    const double mean = mean_radiance(image)[0];
    for (const EnvImage& level : all_levels(std::move(image), seam))
      EXPECT_NEAR(mean_radiance(level)[0] / mean, 1, 1e-5) << text_of(seam) << " " << level.height();
  }
}

TEST_P(SeamLaws, AverageHasNoSeamOrLessOfIt) {
  for (const int width : {1, 4}) {
    const Seam average{SeamMethod::average, width};
    EnvImage image = noise(layout(), tall(16), average);
    const double before = seam_error(image).rms;
    fix_seams(image, average);
    const double after = seam_error(image).rms;
    if (faces_meet(layout()) && image.placement == Placement::centre)
      EXPECT_LT(after, 1e-9);
    else if (layout().info().domain == Domain::square)
      EXPECT_LT(after, 0.01 * before);
    else
      EXPECT_LE(after, 1.02 * before);  // of discs nothing meets but at a point
    for (const Image& face : image.faces)
      for (std::size_t n = 0; n < face.value_count(); ++n) ASSERT_GE(face.data()[n], 0.0f);
  }
}

TEST_P(SeamLaws, AverageChangesNothingFarFromEdges) {
  const Seam average{SeamMethod::average, 2};
  const EnvImage before = painted(layout(), 16, average, smooth);
  EnvImage after = painted(layout(), 16, average, smooth);
  fix_seams(after, average);
  // But for the gain that keeps the mean, which is the same everywhere.
  const double gain =
      *after.faces[0].at(after.faces[0].width() / 2, 8) / *before.faces[0].at(before.faces[0].width() / 2, 8);
  EXPECT_NEAR(gain, 1, 0.01);
  for (std::size_t f = 0; f < before.faces.size(); ++f) {
    const Image& face = before.faces[f];
    for (int j = 2; j < face.height() - 2; ++j)
      for (int i = 2; i < face.width() - 2; ++i)
        ASSERT_NEAR(*after.faces[f].at(i, j) / *face.at(i, j), gain, 1e-6) << i << "," << j;
  }
}

TEST_P(SeamLaws, GuttersLeaveNoMoreThanIsInsideFaces) {
  for (const int texels : {1, 3}) {
    const Seam gutter{SeamMethod::gutter, texels};
    for (const EnvImage& level : all_levels(painted(layout(), 32, gutter, smooth), gutter)) {
      if (level.height() < 4) break;  // no inside to speak of
      const SeamError error = error_of(level, gutter);
      EXPECT_GT(error.points, 0);
      EXPECT_LE(error.largest, error.inside_largest) << text_of(gutter) << " " << level.height();
      EXPECT_LE(error.rms, error.inside_rms) << text_of(gutter) << " " << level.height();
    }
  }
}

const EnvImage& latlong(const char* name) {
  static std::map<std::string, EnvImage>* const read = new std::map<std::string, EnvImage>;
  EnvImage& image = (*read)[name];
  if (image.faces.empty()) {
    Result<PictureFile> file = read_pictures(std::string(ENVCONV_TESTDATA "/panoramas/") + name, {.trust_input = true});
    EXPECT_TRUE(file);
    image.layout = find_layout("latlong");
    image.channels = file->pictures[0].channels;
    image.faces.push_back(std::move(file->pictures[0].image));
  }
  return image;
}
EnvImage panorama(const Layout& layout, int height, const char* name,
                  const Mat3& frame = find_frame("world")->consumer_from_world) {
  ResampleOptions how;
  how.layout = &layout;
  how.height = height;
  how.consumer_from_world = frame;
  Result<EnvImage> made = resample(latlong(name), how);
  EXPECT_TRUE(made);
  return std::move(*made);
}

void expect_no_more_than_inside(EnvImage level, const char* name) {
  const Seam gutter{SeamMethod::gutter, 2};
  fix_seams(level, gutter);
  const SeamError error = error_of(level, gutter);
  EXPECT_LE(error.largest, error.inside_largest) << name << " " << level.height();
  EXPECT_LE(error.rms, error.inside_rms) << name << " " << level.height();
}

// Of panoramas, with suns and lamps that at small levels lie on seams.
TEST_P(SeamLaws, GuttersOfPanoramasLeaveNoMoreThanIsInsideFaces) {
  const Seam gutter{SeamMethod::gutter, 2};
  for (const char* name : {"venice.hdr", "city.exr", "interior.exr"})
    for (EnvImage& level : all_levels(panorama(layout(), tall(32), name), gutter))
      if (level.height() >= tall(8)) expect_no_more_than_inside(std::move(level), name);
  expect_no_more_than_inside(panorama(layout(), 64, "interior.exr"), "interior");
  for (const int height : {64, 256})
    expect_no_more_than_inside(panorama(layout(), height, "courtyard.exr"), "courtyard");
}

// One direction is all of the rim of these, and the larger the map, the more texels its detail spreads over.
TEST(SeamError, UnderGuttersOfLargeDiscs) {
  for (const char* layout : {"sphere-map", "mirror-ball", "angular-map"})
    expect_no_more_than_inside(panorama(*find_layout(layout), 1000, "courtyard.exr"), layout);
}

// Lamps of less than a texel come to lie on the very rim.
TEST(SeamError, UnderGuttersOfLampsTurnedAnyWay) {
  for (const char* name : {"paraboloid", "dual-equidistant", "angular-map"})
    for (int turn = 0; turn < 8; ++turn) {
      const Mat3 frame = rotation_matrix({.yaw = 45.0 * turn, .pitch = 75.0 * turn, .roll = 47.0 * turn});
      expect_no_more_than_inside(panorama(*find_layout(name), 32, "interior.exr", frame), name);
    }
}

// What the comment in seam_gutter.cpp derives: the rim of a sphere map is one direction, and texels along it are the
// root of a texel long.  With four times the texels the seam error halves only, and so do steps as long inside, where
// those of an angular map become a quarter.
TEST(SeamError, OfASphereMapFallsAsTheRootOfATexel) {
  const Seam gutter{SeamMethod::gutter, 2};
  const auto measured = [&](const char* name, int height) {
    return error_of(painted(*find_layout(name), height, gutter, [](Vec3 d) { return 2 + d.x + 0.5 * d.y; }), gutter);
  };
  for (const auto& [name, factor] : {std::pair{"sphere-map", 0.5}, {"angular-map", 0.25}}) {
    const SeamError coarse = measured(name, 256), fine = measured(name, 1024);
    EXPECT_NEAR(fine.inside_rms / coarse.inside_rms, factor, 0.08) << name;  // of whole texels
    EXPECT_NEAR(fine.rms / coarse.rms, factor, 0.05) << name;
  }
}

// Texels that no curve comes near are what they were, bit for bit; of those that are cut the part is found again.
void expect_the_same(const EnvImage& image, int f, const Image& back) {
  const Image& face = image.faces[static_cast<std::size_t>(f)];
  ASSERT_EQ(back.width(), face.width());
  ASSERT_EQ(back.height(), face.height());
  for (int y = 0; y < face.height(); ++y)
    for (int x = 0; x < face.width(); ++x) {
      const auto owns = [&](double i, double j) {
        return image.layout->owns(f, u_from_texel(x + i, face.width(), image.placement),
                                  u_from_texel(y + j, face.height(), image.placement));
      };
      if (!owns(0, 0)) continue;
      const bool far = owns(-0.75, -0.75) && owns(0, -0.75) && owns(0.75, -0.75) && owns(-0.75, 0) && owns(0.75, 0) &&
                       owns(-0.75, 0.75) && owns(0, 0.75) && owns(0.75, 0.75);
      ASSERT_NEAR(*back.at(x, y), *face.at(x, y), far ? 0 : 1e-5) << x << "," << y;
    }
}

// A sun on a seam included, for every level.
TEST_P(SeamLaws, TheMeanIsKeptUnderGutters) {
  const Seam gutter{SeamMethod::gutter, 2};
  for (const EnvImage& level : all_levels(noise(layout(), tall(16), gutter), gutter)) {
    EnvImage back = empty_map(layout(), level.height(), gutter);
    back.faces = without_gutters(layout(), level.placement, with_gutters(level, 2), 2);
    EXPECT_NEAR(mean_radiance(back)[0] / mean_radiance(level)[0], 1, 1e-6) << level.height();
  }
}

TEST_P(SeamLaws, GuttersAreTrueRadianceAndComeOffAgain) {
  const Seam gutter{SeamMethod::gutter, 2};
  const EnvImage image = painted(layout(), 32, gutter, [](Vec3 d) { return 2 + d.x + 0.5 * d.y - 0.25 * d.z; });
  const std::vector<Image> grown = with_gutters(image, 2),
                           middle = without_gutters(layout(), image.placement, grown, 2);
  for (std::size_t f = 0; f < grown.size(); ++f) {
    const Image &face = image.faces[f], &out = grown[f];
    ASSERT_EQ(out.width(), face.width() + 4);
    ASSERT_EQ(out.height(), face.height() + 4);
    expect_the_same(image, static_cast<int>(f), middle[f]);
    if (layout().info().domain == Domain::disc) continue;  // the rectangle's edge is far beyond the rim
    for (int y = 0; y < out.height(); ++y)
      for (int x = 0; x < out.width(); ++x) {
        const double u = u_from_texel(x - 2, face.width(), image.placement),
                     v = u_from_texel(y - 2, face.height(), image.placement);
        const Vec3 d = layout().direction(static_cast<int>(f), u, v);
        // Clamped next to a pole or a corner, bilinear reads are off by half a texel at most.
        const double side = 2 * test::mean_texel(layout(), face_size(layout(), 0, 32).width);
        EXPECT_NEAR(*out.at(x, y), 2 + d.x + 0.5 * d.y - 0.25 * d.z, 1.2 * side) << x << "," << y;
      }
  }
}

// Through a file: recorded, recognised, and every texel as it was.
TEST_P(SeamLaws, ThroughFiles) {
  const std::string path =
      (std::filesystem::temp_directory_path() / ("envconv-seam-" + std::to_string(getpid()) + ".exr")).string();
  const Frame& world = *find_frame("world");
  const Packing& packing = default_packing(layout());
  for (const Seam seam : {Seam{SeamMethod::stretch, 0}, Seam{SeamMethod::gutter, 3}, Seam{SeamMethod::average, 2}})
    for (const int level : {0, 2}) {
      EnvImage image =
          std::move(all_levels(painted(layout(), 16, seam, smooth), seam)[static_cast<std::size_t>(level)]);
      std::vector<Image> faces;
      if (seam.gutter())
        faces = with_gutters(image, seam.gutter());
      else
        for (const Image& face : image.faces) faces.push_back(face.clone());
      std::vector<Size> sizes;
      for (const Image& face : faces) sizes.push_back({face.width(), face.height()});
      const Result<PackedShape> shape = packed_shape(layout(), packing, sizes);
      ASSERT_TRUE(shape);
      std::vector<Picture> pictures;
      pictures.push_back({"", pack(*shape, std::move(faces)), image.channels, PixelType::float32});
      WriteOptions write;
      write.type = PixelType::float32;
      write.metadata = metadata_of(layout(), packing, world, {}, {seam, 16, level});
      ASSERT_TRUE(write_pictures(path, pictures, write));
      ReadOptions read;
      read.trust_input = true;
      Result<PictureFile> file = read_pictures(path, read);
      ASSERT_TRUE(file) << file.error().message;
      const Result<Recognition> recognition = recognize(*file, {});
      ASSERT_TRUE(recognition) << recognition.error().message;
      EXPECT_EQ(recognition->seam, seam);
      EXPECT_EQ(recognition->height, image.height());
      const Result<EnvImage> back = to_environment(std::move(*file), *recognition);
      ASSERT_TRUE(back) << back.error().message;
      EXPECT_EQ(back->placement, image.placement);
      for (int f = 0; f < layout().face_count(); ++f)
        expect_the_same(image, f, back->faces[static_cast<std::size_t>(f)]);
    }
  std::filesystem::remove(path);
}

INSTANTIATE_TEST_SUITE_P(All, SeamLaws, testing::ValuesIn([] {
                           std::vector<const Layout*> list;
                           for (const Layout& layout : all_layouts()) list.push_back(&layout);
                           return list;
                         }()),
                         [](const auto& info) { return test::test_name(*info.param); });

// Faces of one value each: what the error must be can be counted on one's fingers.
TEST(SeamError, OfACubeOfPlainFaces) {
  EnvImage image = empty_map(*find_layout("cube"), 8, {});
  for (std::size_t f = 0; f < 6; ++f) image.faces[f].fill(static_cast<float>(f));
  const SeamError error = seam_error(image);
  double squares = 0;
  for (int a = 0; a < 6; ++a)
    for (int b = a + 1; b < 6; ++b)
      if (a / 2 != b / 2) squares += (a - b) * (a - b);  // opposite faces don't meet
  EXPECT_NEAR(error.largest, 5 / 2.5, 1e-6);
  EXPECT_NEAR(error.rms, std::sqrt(squares / 12) / 2.5, 1e-6);
  EXPECT_EQ(error.inside_largest, 0);
  EXPECT_EQ(error.inside_rms, 0);
  EXPECT_EQ(error.points, 6 * 4 * 3 * 8);
}

// Noise has no direction and no place: without a method, what the two sides' texels differ by at a seam is what any two
// texels differ by, sqrt(2) sigma, and the same inside.  Points between texels show their interpolation: at thirds of
// the way, whose weights square to 5/9, and one of three points is a texel's centre.
TEST(SeamError, OfNoiseIsThatOfItsTexels) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> brightness(0.0, 1.0);
  const EnvImage image = painted(*find_layout("cube"), 64, {}, [&](Vec3) { return brightness(random); });
  const SeamError error = seam_error(image);
  const double texels = std::sqrt(2.0 / 12) / 0.5;  // of uniform noise: variance 1/12, mean 1/2
  EXPECT_NEAR(error.inside_rms / texels, 1, 0.03);
  EXPECT_NEAR(error.rms / texels, std::sqrt((1 + 2 * 5.0 / 9) / 3), 0.03);
}

// A lamp of one texel at the middle of a cube's edge: both figures see it, and nothing else.
TEST(SeamError, OfALampAtAnEdge) {
  const int n = 16;
  EnvImage image = painted(*find_layout("cube"), n, {}, [](Vec3) { return 0.0; });
  *image.faces[0].at(n - 1, n / 2) = static_cast<float>(sun);
  const double mean = mean_radiance(image)[0];
  const SeamError error = seam_error(image);
  EXPECT_NEAR(error.largest * mean / sun, 1, 1e-6);
  EXPECT_NEAR(error.inside_largest * mean / sun, 1, 1e-6);
  // Along the seam, met from both sides: its centre, and thirds of the way to both neighbours.
  EXPECT_NEAR(std::pow(error.rms * mean / sun, 2) * static_cast<double>(error.points),
              2 * (1 + 2 * (4.0 / 9 + 1.0 / 9)), 1e-4);
}

// On a lat-long the step over the seam is one of W texels around: that of the sine there.  Steps as long inside are of
// one texel at the equator and of several near the poles, rounded to whole ones.
TEST(SeamError, OfASineAroundALatLong) {
  const EnvImage image = painted(*find_layout("latlong"), 32, {}, [](Vec3 d) { return 2 + d.x; });
  const SeamError error = seam_error(image);
  const double step = 2 * std::sin(M_PI / 64);  // sin(pi + h) - sin(pi - h), h half a texel
  EXPECT_GE(error.inside_largest, step / 2 - 1e-3);
  EXPECT_LE(error.inside_largest, step / 2 * 1.4);
  EXPECT_GE(error.largest, step / 2 - 1e-3);  // at the poles it is more
}

TEST(SeamNames, ParseAndPrint) {
  for (const char* text : {"none", "average", "average:3", "stretch", "gutter:4"}) {
    const Result<Seam> seam = parse_seam(text);
    ASSERT_TRUE(seam) << text;
    EXPECT_EQ(text_of(*seam), text);
  }
  EXPECT_EQ(parse_seam("average")->texels, 1);
  for (const char* text : {"", "nonesuch", "gutter", "gutter:", "gutter:0", "gutter:65", "gutter:2x", "stretch:1",
                           "none:1", "average:-1", "average:1000000000000"})
    EXPECT_FALSE(parse_seam(text)) << text;
}

// (N-1)/N and 1/(2N): the centres of the first and the last texel are met at u = 0 and 1.
TEST(SeamNames, LookupScale) {
  const LookupScale stretch = lookup_scale(8, Placement::inclusive, 0);
  EXPECT_DOUBLE_EQ(stretch.scale, 7.0 / 8);
  EXPECT_DOUBLE_EQ(stretch.offset, 1.0 / 16);
  const LookupScale gutter = lookup_scale(12, Placement::centre, 2);  // 8 texels and 2 on each side
  EXPECT_DOUBLE_EQ(gutter.scale, 8.0 / 12);
  EXPECT_DOUBLE_EQ(gutter.offset, 2.0 / 12);
  const LookupScale plain = lookup_scale(8, Placement::centre, 0);
  EXPECT_DOUBLE_EQ(plain.scale, 1);
  EXPECT_DOUBLE_EQ(plain.offset, 0);
}

// Metadata that lies about sizes is not believed.
TEST(SeamFiles, WrongSizesAreRefusedOrIgnored) {
  const Layout& cube = *find_layout("cube");
  PictureFile file;
  file.path = "a.exr";
  file.pictures.push_back({"", Image(48, 8, 1), Channels::standard(1), PixelType::float32});
  file.metadata = metadata_of(cube, default_packing(cube), *find_frame("world"), {}, {{SeamMethod::gutter, 2}, 100, 3});
  const Result<Recognition> plain = recognize(file, {});
  ASSERT_TRUE(plain) << plain.error().message;
  EXPECT_EQ(plain->seam, Seam{});
  EXPECT_EQ(plain->height, 8);
  for (const char* size : {"", "-1", "99999999999", "x", "16777216"}) {
    file.metadata["envconv:size"] = size;
    EXPECT_TRUE(recognize(file, {})) << size;
  }
  file.metadata["envconv:size"] = "16";  // 16 >> 3 and twice 2: 6x6
  file.pictures[0].image = Image(36, 6, 1);
  const Result<Recognition> level = recognize(file, {});
  ASSERT_TRUE(level) << level.error().message;
  EXPECT_EQ(level->height, 2);
  EXPECT_EQ(level->seam.gutter(), 2);
}

}  // namespace
}  // namespace envconv
