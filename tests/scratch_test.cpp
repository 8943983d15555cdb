// SPDX-License-Identifier: Apache-2.0
// Images in files: the same pixels, out of memory when they should be, and no trace of them.
#include "scratch.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <new>
#include <numeric>
#include <span>
#include <stdexcept>
#include <string_view>
#include <vector>

#include "image.h"
#include "io.h"
#include "mip.h"
#include "packing.h"
#include "resample.h"
#include "temporary_folder.h"

namespace envconv {
namespace {

constexpr std::size_t MiB = std::size_t{1} << 20;
constexpr std::size_t everything = std::size_t{1} << 60;

// Without a stream: what that frees, a sanitizer keeps, and counting would grow what is counted.
std::size_t resident() {
  char text[128] = {};
  const int file = ::open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
  const ssize_t size = ::read(file, text, sizeof text - 1);
  ::close(file);
  std::size_t pages = 0;
  if (size <= 0 || std::sscanf(text, "%*u %zu", &pages) != 1) throw std::runtime_error("no /proc/self/statm");
  return pages * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

// What the thread sanitizer keeps beside every page that was touched once: it stays when the page goes, and counts.
constexpr std::size_t shadow_of([[maybe_unused]] std::size_t bytes) {
#ifdef __SANITIZE_THREAD__
  return 4 * bytes;
#else
  return 0;
#endif
}

float value_at(std::size_t i) { return static_cast<float>(i % 8191) * 0.25f; }

void fill_with_values(Image& image) {
  for (std::size_t i = 0; i < image.value_count(); ++i) image.data()[i] = value_at(i);
}

bool same(const Image& a, const Image& b) {
  return a.width() == b.width() && a.height() == b.height() && a.channels() == b.channels() &&
         std::equal(a.data(), a.data() + a.value_count(), b.data());
}

// A folder on the disk that the tests are built on: /tmp may lie in memory.
class ScratchTest : public testing::Test {
 protected:
  ScratchTest() {
    std::string pattern = std::string(ENVCONV_BUILD) + "/scratch-test-XXXXXX";
    if (!::mkdtemp(pattern.data())) throw std::runtime_error("no folder");
    folder_ = pattern;
  }
  ~ScratchTest() override { std::filesystem::remove_all(folder_); }
  bool folder_is_empty() const { return std::filesystem::is_empty(folder_); }
  std::shared_ptr<Scratch> scratch(std::size_t limit) const { return std::make_shared<Scratch>(folder_, limit); }

  std::string folder_;
};

TEST_F(ScratchTest, KeepsPixelsWhileTheirPagesComeAndGo) {
  Image image(2048, 1024, 3, scratch(0));
  ASSERT_TRUE(image.scratch());
  constexpr int values = 2048 * 3;
  const auto zero = [](float v) { return v == 0.0f; };
  ASSERT_TRUE(std::all_of(image.data(), image.data() + image.value_count(), zero));
  std::vector<float> expected(values);
  const auto fill = [&](int y) { std::iota(expected.begin(), expected.end(), static_cast<float>(y * 7)); };
  for (int y = 0; y < image.height(); ++y) {
    fill(y);
    std::copy(expected.begin(), expected.end(), image.row(y));
    if (y % 100 == 0) image.relieve();
  }
  for (int y = 0; y < image.height(); ++y) {
    fill(y);
    ASSERT_TRUE(std::equal(expected.begin(), expected.end(), image.row(y))) << y;
  }
  EXPECT_TRUE(folder_is_empty()) << "while the image lives";
}

TEST_F(ScratchTest, BoundsWhatIsInMemory) {
  ASSERT_GT(resident(), 0u) << "no /proc to see it by";
  const std::size_t before = resident(), limit = before + 32 * MiB;
  Image image(8192, 2048, 2, scratch(limit));  // 128 MiB
  std::size_t most = 0;
  for (int y = 0; y < image.height(); ++y) {
    std::fill_n(image.row(y), 8192 * 2, 1.0f);
    most = std::max(most, resident());
  }
  // What rows touch until the next look, and the system along with it.
  EXPECT_LT(most, limit + 4 * MiB + shadow_of(128 * MiB));
  EXPECT_GT(most, limit - 8 * MiB) << "no more is unmapped than is asked for";
}

TEST_F(ScratchTest, BoundsWhatSingleTexelsBring) {
  const std::size_t before = resident(), limit = before + 32 * MiB;
  Image image(8192, 2048, 2, scratch(limit));  // 128 MiB
  image.fill(1.0f);
  image.relieve();
  std::size_t most = 0;
  float sum = 0;
  for (int pass = 0; pass < 4; ++pass) {
    for (int y = 0; y < image.height(); ++y) {
      image.texels_touched();
      sum += *image.at(pass * 2048, y);  // one page, and those around it
      most = std::max(most, resident());
    }
  }
  EXPECT_EQ(sum, 4.0f * 2048);
  EXPECT_LT(most, limit + 4 * MiB + shadow_of(128 * MiB));
}

TEST_F(ScratchTest, WatchesByItself) {
  const std::size_t before = resident();
  Image image(8192, 2048, 2, scratch(0));  // 128 MiB
  fill_with_values(image);
  // Nobody calls relieve(): the thread does, within a second even on a busy machine.
  const std::size_t most = before + 64 * MiB + shadow_of(128 * MiB);
  for (int i = 0; i < 1000 && resident() > most; ++i) ::usleep(1000);
  EXPECT_LT(resident(), most);
}

TEST_F(ScratchTest, WhatIsMadeOfAnImageLivesWithIt) {
  const Layout& cube = *find_layout("cube");
  const auto disk = scratch(0);
  const auto make = [&](const std::shared_ptr<Scratch>& where) {
    EnvImage image;
    image.layout = &cube;
    image.channels = Channels::standard(3);
    for (int f = 0; f < 6; ++f) fill_with_values(image.faces.emplace_back(512, 512, 3, where));
    return image;
  };
  const EnvImage in_memory = make(nullptr), on_disk = make(disk);
  const auto levels = make_mips(in_memory, {}), disk_levels = make_mips(on_disk, {});
  ASSERT_TRUE(levels && disk_levels);
  for (std::size_t k = 0; k < levels->size(); ++k) {
    for (std::size_t f = 0; f < 6; ++f) {
      EXPECT_EQ((*disk_levels)[k].faces[f].scratch(), disk);
      EXPECT_TRUE(same((*levels)[k].faces[f], (*disk_levels)[k].faces[f])) << k << " " << f;
    }
  }
  for (const char* name : {"row", "column", "cross", "vcross"}) {
    const Packing& packing = *find_packing(name);
    auto a = pack(cube, packing, make(nullptr).faces), b = pack(cube, packing, make(disk).faces);
    ASSERT_TRUE(a && b) << name;
    EXPECT_EQ(b->scratch(), disk);
    EXPECT_TRUE(same(*a, *b)) << name;
    const auto back = unpack(cube, packing, std::move(*b));
    ASSERT_TRUE(back) << name;
    for (std::size_t f = 0; f < 6; ++f) {
      EXPECT_EQ((*back)[f].scratch(), disk);
      EXPECT_TRUE(same((*back)[f], in_memory.faces[f])) << name << " " << f;
    }
  }
  EXPECT_TRUE(same(on_disk.faces[0].clone(), in_memory.faces[0]));
}

TEST_F(ScratchTest, FilesAreReadIntoIt) {
  Picture picture{"", Image(2048, 1024, 3), Channels::standard(3), PixelType::float32};
  fill_with_values(picture.image);
  const TemporaryFolder files;
  struct Case {
    const char *name, *compression;
  };
  // Chunks read here, by OpenEXR, and pictures that are decoded whole.
  for (const auto& [name, compression] : {Case{"a.exr", "none"}, {"b.exr", "zip"}, {"c.exr", "piz"}, {"d.ktx2", ""}}) {
    WriteOptions write;
    write.type = PixelType::float32;
    write.type_given = true;
    write.compression = compression;
    std::vector<Picture> pictures;
    pictures.push_back({"", picture.image.clone(), picture.channels, picture.type});
    ASSERT_TRUE(write_pictures(files.path(name), pictures, write)) << name;
    for (const bool trusted : {false, true}) {
      ReadOptions read;
      read.trust_input = trusted;
      std::shared_ptr<Scratch> disk;
      // The header tells how much it will be: then is the time to decide.
      read.accept = [&](const PictureFile&) -> Result<Ok> {
        read.scratch = disk = scratch(0);
        return Ok{};
      };
      const auto file = read_pictures(files.path(name), read);
      ASSERT_TRUE(file) << file.error().message;
      EXPECT_EQ(file->pictures[0].image.scratch(), disk);
      EXPECT_TRUE(same(file->pictures[0].image, picture.image)) << name << trusted;
    }
  }
}

// Bands of lines and tiles that begin anywhere in a chunk, of pictures that become others on the way.
TEST_F(ScratchTest, FilesAreReadAsIntoMemory) {
  Picture picture{"", Image(1500, 1400, 4), Channels::standard(4), PixelType::half};
  fill_with_values(picture.image);
  const TemporaryFolder files;
  std::vector<std::vector<Picture>> levels(2);
  levels[0].push_back(std::move(picture));
  levels[1].push_back({"", Image(750, 700, 4), Channels::standard(4), PixelType::half});
  fill_with_values(levels[1][0].image);
  for (const char* name : {"lines.exr", "tiles.exr", "lines.tif", "lines.hdr"}) {
    WriteOptions write;
    const bool tiles = std::string_view(name) == "tiles.exr";
    if (std::string_view(name) == "lines.hdr") {
      levels[0][0].channels = Channels::standard(3);
      Image colors(1500, 1400, 3);
      fill_with_values(colors);
      levels[0][0].image = std::move(colors);
    }
    const auto written = write_levels(files.path(name), std::span(levels).first(tiles ? 2 : 1), write);
    ASSERT_TRUE(written) << written.error().message;
    for (const bool trusted : {false, true}) {
      for (const bool drop_alpha : {false, true}) {
        ReadOptions read;
        read.trust_input = trusted;
        read.drop_alpha = drop_alpha;
        const auto expected = read_pictures(files.path(name), read);
        ASSERT_TRUE(expected) << expected.error().message;
        EXPECT_EQ(expected->pictures[0].image.scratch(), nullptr);
        read.scratch = scratch(0);
        const auto file = read_pictures(files.path(name), read);
        ASSERT_TRUE(file) << file.error().message;
        EXPECT_TRUE(same(file->pictures[0].image, expected->pictures[0].image)) << name << trusted << drop_alpha;
      }
    }
  }
}

TEST_F(ScratchTest, SmallImagesStayInMemory) {
  const auto disk = scratch(0);
  Image small(16, 16, 4, disk);
  ASSERT_EQ(::rmdir(folder_.c_str()), 0);
  EXPECT_NO_THROW(small.sibling(32, 32, 4));
  EXPECT_THROW(small.sibling(1024, 1024, 4), std::bad_alloc) << "it would live where the small one's like do";
  ASSERT_TRUE(disk->failure());
}

TEST_F(ScratchTest, NoRoomIsAnError) {
  const auto disk = scratch(0);
  EXPECT_FALSE(disk->failure());
  // A limit on the size of files is the nearest thing to a full disk.
  const auto ignored = std::signal(SIGXFSZ, SIG_IGN);
  rlimit old{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &old), 0);
  const rlimit low{8 * MiB, old.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &low), 0);
  EXPECT_NO_THROW(Image(512, 512, 4, disk));
  EXPECT_THROW(Image(2048, 1024, 4, disk), std::bad_alloc);
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &old), 0);
  std::signal(SIGXFSZ, ignored);
  ASSERT_TRUE(disk->failure());
  EXPECT_EQ(disk->failure()->code, ErrorCode::output);
  EXPECT_EQ(disk->failure()->system, EFBIG);
  EXPECT_NE(disk->failure()->message.find("34 MB of scratch storage in " + folder_), std::string::npos)
      << disk->failure()->message;
  EXPECT_TRUE(folder_is_empty());
}

TEST(Memory, RowsThatAreForgottenLeaveTheOthers) {
  const auto disk = [](std::size_t limit) { return std::make_shared<Scratch>(ENVCONV_BUILD, limit); };
  for (const auto& where : {std::shared_ptr<Scratch>(), disk(0), disk(everything)}) {
    Image image(1000, 4000, 3, where);
    fill_with_values(image);
    const std::size_t before = resident();
    image.forget_rows_above(3001);
    for (std::size_t i = std::size_t{3001} * 3000; i < image.value_count(); ++i) {
      ASSERT_EQ(image.data()[i], value_at(i)) << i;
    }
    if (!where) {
      EXPECT_LT(resident(), before - 30 * MiB);
    }
  }
}

// The memory that a picture was decoded to is the image: it can be given back in parts as well.
TEST(Memory, RowsOfReadPicturesAreForgottenToo) {
  Picture picture{"", Image(1000, 4000, 3), Channels::standard(3), PixelType::float32};
  fill_with_values(picture.image);
  const TemporaryFolder files;
  WriteOptions write;
  write.type = PixelType::float32;
  write.type_given = true;
  std::vector<Picture> pictures;
  pictures.push_back(std::move(picture));
  ASSERT_TRUE(write_pictures(files.path("a.exr"), pictures, write));
  for (const bool trusted : {false, true}) {
    ReadOptions read;
    read.trust_input = trusted;
    auto file = read_pictures(files.path("a.exr"), read);
    ASSERT_TRUE(file) << file.error().message;
    Image& image = file->pictures[0].image;
    ASSERT_TRUE(same(image, pictures[0].image));
    const std::size_t before = resident();
    image.forget_rows_above(3001);
    EXPECT_LT(resident(), before - 30 * MiB);
    for (std::size_t i = std::size_t{3001} * 3000; i < image.value_count(); ++i) {
      ASSERT_EQ(image.data()[i], value_at(i)) << i;
    }
  }
}

TEST(Memory, FileSystemsThatLieInMemory) {
  EXPECT_FALSE(Scratch::lies_in_memory("/proc"));
  if (std::filesystem::exists("/dev/shm")) {
    EXPECT_TRUE(Scratch::lies_in_memory("/dev/shm"));
  }
  EXPECT_FALSE(Scratch::lies_in_memory("/there/is/none"));
}

}  // namespace
}  // namespace envconv
