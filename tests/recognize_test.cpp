// SPDX-License-Identifier: Apache-2.0
// What a file is taken for: one table of facts, and the law that what was written with metadata is read as what it was.
#include "recognize.h"

#include <gtest/gtest.h>

#include <string>

#include "layout_cases.h"

namespace envconv {
namespace {

const Layout* layout(std::string_view name) { return find_layout(name); }
const Packing* packing(std::string_view name) { return find_packing(name); }

Picture picture(int width, int height, const std::string& name = "", float value = 0.5f) {
  Picture p;
  p.name = name;
  p.image = Image(width, height, 3);
  p.image.fill(value);
  p.channels = Channels::standard(3);
  return p;
}

PictureFile file(int width, int height, Metadata metadata = {}) {
  PictureFile f;
  f.path = "sky.exr";
  f.format = "openexr";
  f.pictures.push_back(picture(width, height));
  f.metadata = std::move(metadata);
  return f;
}

PictureFile faces(const std::vector<std::string>& names, int size, Metadata metadata = {}) {
  PictureFile f;
  f.path = "sky.exr";
  f.format = "openexr";
  float value = 1;
  for (const std::string& name : names) f.pictures.push_back(picture(size, size, name, value++));
  f.metadata = std::move(metadata);
  return f;
}

// "cube row 32", or the error's text.
std::string recognized(const PictureFile& f, const InputHints& hints = {}) {
  const Result<Recognition> r = recognize(f, hints);
  if (!r) {
    EXPECT_EQ(r.error().code, ErrorCode::input);
    EXPECT_TRUE(r.error().message.starts_with("sky.exr: ")) << r.error().message;
    return r.error().message;
  }
  EXPECT_FALSE(r->how.empty());
  return std::string(r->layout->name()) + " " + std::string(r->packing->name) + " " + std::to_string(r->height);
}

bool contains(const std::string& text, std::string_view part) { return text.find(part) != std::string::npos; }

TEST(Recognize, ByShape) {
  EXPECT_EQ(recognized(file(512, 256)), "latlong row 256");
  EXPECT_EQ(recognized(file(192, 32)), "cube row 32");
  EXPECT_EQ(recognized(file(32, 192)), "cube column 32");
  EXPECT_EQ(recognized(file(128, 96)), "cube cross 32");  // one value everywhere, in the unused cells too
  EXPECT_EQ(recognized(file(96, 128)), "cube vcross 32");
  EXPECT_EQ(recognized(file(2, 1)), "latlong row 1");
  EXPECT_EQ(recognize(file(512, 256), {})->how, "2:1 is latlong");
  EXPECT_EQ(recognize(file(192, 32), {})->how, "6:1 is cube in a row");
  EXPECT_EQ(recognize(file(512, 256), {})->frame->name, "world");
}

TEST(Recognize, AShapeOfOneLayoutOnly) {
  // The Mercator band's height is irrational: no other shape meets it.
  const Layout& conformal = *layout("polar-capped-conformal");
  const Size size = packed_shape(conformal, *packing("grid"), 301)->size;
  EXPECT_EQ(recognized(file(size.width, size.height)), "polar-capped-conformal grid 301");
  EXPECT_TRUE(contains(recognize(file(size.width, size.height), {})->how, "nothing but"));
}

TEST(Recognize, AmbiguityIsAnErrorThatListsTheCandidates) {
  const std::string square = recognized(file(64, 64));
  for (const char* name : {"sphere-map", "mirror-ball", "angular-map", "octahedral", "octahedral-equal-area", "--from"})
    EXPECT_TRUE(contains(square, name)) << square;
  EXPECT_FALSE(contains(square, "cube")) << square;

  const std::string three_by_two = recognized(file(96, 64));
  for (const char* name : {"cube (grid)", "cube (youtube)", "diamond-6"})
    EXPECT_TRUE(contains(three_by_two, name)) << three_by_two;

  EXPECT_TRUE(contains(recognized(file(1001, 500)), "no layout"));
  EXPECT_TRUE(contains(recognized(file(1001, 500)), "2:1"));
}

TEST(Recognize, ACrossHasEmptyCells) {
  PictureFile busy = file(128, 96);
  busy.pictures[0].image.at(5, 5)[1] = 0.25f;  // in an unused cell
  const std::string error = recognized(busy);
  for (const char* name : {"cube (cross)", "diamond-12", "healpix"}) EXPECT_TRUE(contains(error, name)) << error;
  // Told that it is a cross, or a cube, it may hold anything there.
  EXPECT_EQ(recognized(busy, {.packing = packing("cross")}), "cube cross 32");
  EXPECT_EQ(recognized(busy, {.layout = layout("cube")}), "cube cross 32");

  PictureFile used = file(128, 96);
  used.pictures[0].image.at(40, 5)[1] = 0.25f;  // in the +Y cell
  EXPECT_EQ(recognized(used), "cube cross 32");
  PictureFile tall = file(96, 128);
  tall.pictures[0].image.at(5, 127)[0] = 0;
  EXPECT_TRUE(contains(recognized(tall), "cube (vcross)"));
}

TEST(Recognize, HeadersDo) {
  PictureFile f = file(128, 96);
  f.pictures[0].image = Image::without_pixels(128, 96, 3);
  EXPECT_EQ(recognized(f), "cube cross 32");
  EXPECT_TRUE(contains(recognize(f, {})->how, "presumably"));
  const Recognition r = *recognize(f, {});
  EXPECT_EQ(to_environment(std::move(f), r).error().code, ErrorCode::usage);
}

TEST(Recognize, WhatTheUserSaidComesFirst) {
  EXPECT_EQ(recognized(file(512, 256), {.layout = layout("paraboloid")}), "paraboloid row 256");
  EXPECT_EQ(recognized(file(512, 256), {.layout = layout("diamond-8")}), "diamond-8 grid 128");
  EXPECT_EQ(recognized(file(512, 256), {.layout = layout("latlong-inclusive")}), "latlong-inclusive row 256");
  EXPECT_EQ(recognized(file(64, 64), {.layout = layout("octahedral")}), "octahedral row 64");
  EXPECT_EQ(recognized(file(96, 64), {.layout = layout("equi-angular-cube")}), "equi-angular-cube grid 32");
  EXPECT_EQ(recognized(file(96, 64), {.layout = layout("equi-angular-cube"), .packing = packing("youtube")}),
            "equi-angular-cube youtube 32");
  EXPECT_EQ(recognized(file(96, 64), {.packing = packing("youtube")}), "equi-angular-cube youtube 32");
  EXPECT_EQ(recognized(file(32, 192), {.packing = packing("column")}), "cube column 32");
  EXPECT_EQ(recognize(file(512, 256), {.frame = find_frame("blender")})->frame->name, "blender");
  // Over metadata and container too.
  EXPECT_EQ(recognized(file(512, 256, {{"envconv:layout", "cube"}}), {.layout = layout("latlong")}), "latlong row 256");
  EXPECT_EQ(recognized(file(512, 256, {{"envmap", "latlong"}}), {.layout = layout("latlong")}), "latlong row 256");
}

TEST(Recognize, WhatTheUserSaidMustFit) {
  EXPECT_EQ(recognized(file(1000, 500), {.layout = layout("cube")}),
            "sky.exr: 1000x500 does not fit cube: expected 6:1 (row), 1:6 (column), 3:2 (grid, youtube), 4:3 (cross), "
            "3:4 (vcross)");
  EXPECT_EQ(recognized(file(1001, 500), {.layout = layout("latlong")}),
            "sky.exr: 1001x500 does not fit latlong: expected 2:1");
  EXPECT_EQ(recognized(file(192, 32), {.layout = layout("cube"), .packing = packing("cross")}),
            "sky.exr: 192x32 does not fit cube: expected 4:3 (cross)");
  EXPECT_TRUE(contains(recognized(file(512, 256), {.layout = layout("latlong"), .packing = packing("cross")}),
                       "packing cross is for the six faces of a cube"));
  EXPECT_TRUE(contains(recognized(file(100, 100), {.layout = layout("polar-capped-conformal")}), "about 1.8"));
}

TEST(Recognize, ByMetadata) {
  const PictureFile f = file(512, 256,
                             {{"envconv:layout", "paraboloid"},
                              {"envconv:packing", "row"},
                              {"envconv:frame", "blender"},
                              {"envconv:rotation", "90,-12.5,1e-3"}});
  EXPECT_EQ(recognized(f), "paraboloid row 256");
  const Recognition r = *recognize(f, {});
  EXPECT_EQ(r.frame->name, "blender");
  EXPECT_EQ(r.rotation, (Rotation{90, -12.5, 1e-3}));
  EXPECT_TRUE(contains(r.how, "metadata"));
  EXPECT_TRUE(r.warnings.empty());

  EXPECT_EQ(recognized(file(96, 64, {{"envconv:layout", "cube"}, {"envconv:packing", "youtube"}})), "cube youtube 32");
  // Metadata comes before the container.
  EXPECT_EQ(recognized(file(512, 256, {{"envconv:layout", "latlong"}, {"envmap", "latlong"}})), "latlong row 256");
}

TEST(Recognize, MetadataThatDoesNotHold) {
  // Repacked by other means: the layout is believed, the size decides on the packing.
  const PictureFile repacked = file(32, 192, {{"envconv:layout", "isocube"}, {"envconv:packing", "row"}});
  EXPECT_EQ(recognized(repacked), "isocube column 32");
  EXPECT_EQ(recognize(repacked, {})->warnings.size(), 1u);
  // Cropped or scaled.
  const std::string error = recognized(file(1000, 500, {{"envconv:layout", "cube"}}));
  EXPECT_TRUE(contains(error, "metadata") && contains(error, "cube") && contains(error, "--from")) << error;
  // Written by a later version: known words still count.
  const Result<Recognition> later = recognize(
      file(512, 256, {{"envconv:layout", "origami"}, {"envconv:rotation", "1,2"}, {"envconv:frame", "unity"}}), {});
  ASSERT_TRUE(later.ok());
  EXPECT_EQ(later->layout->name(), "latlong");
  EXPECT_EQ(later->frame->name, "unity");
  EXPECT_EQ(later->rotation, Rotation{});
  EXPECT_EQ(later->warnings.size(), 2u);
  // One file of a set.
  EXPECT_TRUE(contains(recognized(file(64, 64, {{"envconv:layout", "cube"}, {"envconv:packing", "files"}})),
                       "one face of the 6 of cube"));
}

TEST(Recognize, ByTheEnvmapAttribute) {
  EXPECT_EQ(recognized(file(512, 256, {{"envmap", "latlong"}})), "latlong-inclusive row 256");
  EXPECT_EQ(recognized(file(32, 192, {{"envmap", "cube"}})), "openexr-cube column 32");
  // The size is right where the attribute is not.
  const PictureFile odd = file(512, 256, {{"envmap", "unknown 77"}});
  EXPECT_TRUE(contains(recognized(odd), "unknown 77"));
  EXPECT_EQ(recognized(odd, {.layout = layout("latlong")}), "latlong row 256");
  const PictureFile wrong = file(512, 256, {{"envmap", "cube"}});
  EXPECT_EQ(recognized(wrong), "latlong row 256");
  ASSERT_EQ(recognize(wrong, {})->warnings.size(), 1u);
  EXPECT_EQ(recognize(wrong, {})->warnings[0], "its envmap attribute says cube, but 512x256 is not 1:6: ignored");
  const std::string error = recognized(file(500, 499, {{"envmap", "latlong"}}));
  EXPECT_TRUE(contains(error, "envmap attribute says latlong")) << error;
}

TEST(Recognize, ByTheNamesOfParts) {
  EXPECT_EQ(recognized(faces({"px", "nx", "py", "ny", "pz", "nz"}, 8)), "cube parts 8");
  EXPECT_EQ(recognized(faces({"nz", "nx", "py", "ny", "pz", "px"}, 8)), "cube parts 8");
  EXPECT_EQ(recognized(faces({"d0", "d1", "d2", "d3", "d4", "d5"}, 8)), "diamond-6 parts 8");
  const std::string discs = recognized(faces({"front", "back"}, 8));
  EXPECT_TRUE(contains(discs, "paraboloid") && contains(discs, "dual-equidistant")) << discs;
  EXPECT_EQ(recognized(faces({"front", "back"}, 8), {.layout = layout("dual-equidistant")}),
            "dual-equidistant parts 8");
  EXPECT_EQ(recognized(faces({"px", "nx", "py", "ny", "pz", "nz"}, 8, {{"envconv:layout", "isocube"}})),
            "isocube parts 8");
  EXPECT_TRUE(contains(recognized(faces({"beauty", "depth"}, 8)), "holds 2 pictures"));
}

TEST(Recognize, SixPicturesAreACube) {
  PictureFile f = faces({"", "", "", "", "", ""}, 8);
  f.format = "png";
  EXPECT_EQ(recognized(f), "cube files 8");
  EXPECT_TRUE(recognize(f, {})->warnings.empty());
  EXPECT_EQ(recognized(f, {.layout = layout("isocube"), .packing = packing("files")}), "isocube files 8");
  EXPECT_TRUE(contains(recognized(f, {.layout = layout("latlong")}), "holds 6 pictures, where latlong has 1 face"));
  EXPECT_TRUE(contains(recognized(f, {.packing = packing("row")}), "not one in packing row"));
  EXPECT_EQ(recognize(faces({"a", "b", "c", "d", "e", "f"}, 8), {})->warnings.size(), 1u);
  f.pictures[3] = picture(9, 9);
  EXPECT_TRUE(contains(recognized(f), "face ny of cube is 9x9, expected 8x8")) << recognized(f);
  PictureFile none;
  none.path = "sky.exr";
  EXPECT_TRUE(contains(recognized(none), "no picture"));
}

TEST(ToEnvironment, PartsAreOrderedByName) {
  PictureFile f = faces({"nz", "nx", "py", "ny", "pz", "px"}, 4);
  const Recognition r = *recognize(f, {.frame = find_frame("unity")});
  const Result<EnvImage> env = to_environment(std::move(f), r);
  ASSERT_TRUE(env.ok()) << env.error().message;
  EXPECT_EQ(env->faces[0].at(0, 0)[0], 6);  // px came last
  EXPECT_EQ(env->faces[5].at(0, 0)[0], 1);
  EXPECT_EQ(env->consumer_from_world, find_frame("unity")->consumer_from_world);
  EXPECT_EQ(env->placement, Placement::centre);
  EXPECT_EQ(env->channels, Channels::standard(3));
}

TEST(ToEnvironment, ChannelsMustAgree) {
  PictureFile f = faces({"px", "nx", "py", "ny", "pz", "nz"}, 4);
  f.pictures[2].image = Image(4, 4, 1);
  f.pictures[2].channels = Channels::standard(1);
  const Recognition r = *recognize(f, {});
  EXPECT_EQ(to_environment(std::move(f), r).error().code, ErrorCode::input);
}

TEST(ToEnvironment, PlacementFollowsTheLayout) {
  PictureFile f = file(16, 8, {{"envmap", "latlong"}});
  const float* pixels = f.pictures[0].image.data();
  const Recognition r = *recognize(f, {});
  const Result<EnvImage> env = to_environment(std::move(f), r);
  ASSERT_TRUE(env.ok());
  EXPECT_EQ(env->placement, Placement::inclusive);
  EXPECT_EQ(env->faces[0].data(), pixels);  // moved
}

TEST(MetadataOf, IsStable) {
  EXPECT_EQ(metadata_of(*layout("cube"), *packing("cross"), *find_frame("unreal"), {90, -0.0, 0.1}),
            (Metadata{{"envconv:layout", "cube"},
                      {"envconv:packing", "cross"},
                      {"envconv:frame", "unreal"},
                      {"envconv:rotation", "90,0,0.1"}}));
}

// OpenEXR's attribute promises OpenEXR's own picture: nothing else may carry it.
TEST(MetadataOf, EnvmapOnlyWhereItHolds) {
  const auto envmap = [](const char* l, const char* p, const char* frame) {
    const Metadata m = metadata_of(*layout(l), *packing(p), *find_frame(frame), {});
    const auto entry = m.find("envmap");
    return entry == m.end() ? "" : entry->second;
  };
  EXPECT_EQ(envmap("latlong-inclusive", "row", "world"), "latlong");
  EXPECT_EQ(envmap("openexr-cube", "column", "world"), "cube");
  EXPECT_EQ(envmap("openexr-cube", "row", "world"), "");
  EXPECT_EQ(envmap("latlong", "row", "world"), "");
  EXPECT_EQ(envmap("cube", "column", "world"), "");
  EXPECT_EQ(envmap("latlong-inclusive", "row", "blender"), "");
}

class EveryLayout : public testing::TestWithParam<Layout> {};
INSTANTIATE_TEST_SUITE_P(All, EveryLayout, testing::ValuesIn(all_layouts().begin(), all_layouts().end()),
                         [](const auto& info) { return test::test_name(info.param); });

TEST_P(EveryLayout, WhatMetadataRecordsIsRecognised) {
  const Layout& l = GetParam();
  const Rotation rotation{12.3456789012345, -1e-7, 359};
  for (const Packing& p : all_packings()) {
    if (!packs(p, l)) continue;
    for (const Frame& frame : all_frames()) {
      PictureFile f;
      f.path = "sky.exr";
      f.metadata = metadata_of(l, p, frame, rotation);
      if (p.name == "files" || p.name == "parts") {
        for (int i = 0; i < l.face_count(); ++i) {
          const Size s = face_size(l, i, 12);
          f.pictures.push_back(
              picture(s.width, s.height, std::string(l.info().faces[static_cast<std::size_t>(i)].name)));
        }
        f.format = p.name == "parts" ? "openexr" : "png";
      } else {
        const Size s = packed_shape(l, p, 12)->size;
        f.pictures.push_back(picture(s.width, s.height));
      }
      const Result<Recognition> r = recognize(f, {});
      ASSERT_TRUE(r.ok()) << r.error().message;
      EXPECT_EQ(r->layout->name(), l.name());
      EXPECT_EQ(r->packing->name, p.name);
      EXPECT_EQ(r->frame->name, frame.name);
      EXPECT_EQ(r->rotation, rotation);
      EXPECT_EQ(r->height, 12);
      EXPECT_TRUE(r->warnings.empty());
      const Result<EnvImage> env = to_environment(std::move(f), *r);
      ASSERT_TRUE(env.ok()) << env.error().message;
      EXPECT_EQ(env->faces.size(), l.info().faces.size());
      EXPECT_EQ(env->height(), 12);
    }
  }
}

}  // namespace
}  // namespace envconv
