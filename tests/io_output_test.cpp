// SPDX-License-Identifier: Apache-2.0
// Failures of writing leave the old content, and nothing else.
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <utility>
#include <vector>

#include "io.h"
#include "io_cases.h"
#include "output_file.h"

namespace envconv {
namespace {

namespace fs = std::filesystem;

class IoOutput : public Io {
 protected:
  void TearDown() override { ::umount2(path("disk").c_str(), MNT_DETACH); }  // of a test that failed half way
};

TEST_F(IoOutput, AFormatThatCannotHoldItIsRefusedBeforeAnythingIsWritten) {
  WriteOptions half;
  half.type_given = true;
  WriteOptions bad;
  bad.compression = "zap";
  const std::tuple<const char*, WriteOptions, int> cases[] = {
      {"a.xyz", {}, 3}, {"noextension", {}, 3}, {"a.png", half, 3}, {"a.jpg", {}, 4},
      {"a.hdr", {}, 4}, {"a.exr", bad, 3},      {"a.png", bad, 3},  {"a.png", {}, 6},
  };
  for (const auto& [name, options, channels] : cases) {
    const auto can = can_write(path(name), options, 1, channels);
    ASSERT_FALSE(can.ok()) << name;
    EXPECT_EQ(can.error().code, ErrorCode::unsupported);
    EXPECT_EQ(can.error().message.find(path(name) + ": "), 0u) << can.error().message;
    EXPECT_FALSE(write_pictures(path(name), one(make(4, 4, channels)), options).ok());
  }
  EXPECT_NE(can_write("a.xyz", {}, 1, 3).error().message.find("exr hdr"), std::string::npos);
  EXPECT_TRUE(can_write("a.PNG", {}, 1, 3).ok());
  EXPECT_EQ(files_in(folder()), 0);
}

// A side has 16 bits there, and so has the size of what holds metadata.
TEST_F(IoOutput, JpegHasLimits) {
  const auto wide = write_pictures(path("wide.jpg"), one(make(65501, 1, 3)), {});
  ASSERT_FALSE(wide.ok());
  EXPECT_EQ(wide.error().code, ErrorCode::unsupported);
  EXPECT_NE(wide.error().message.find("65500"), std::string::npos) << wide.error().message;
  EXPECT_EQ(files_in(folder()), 0);
  ASSERT_TRUE(write_pictures(path("wide.jpg"), one(make(65500, 1, 3)), {}).ok());
  for (const std::size_t length : {60000, 66000}) {
    WriteOptions write;
    write.metadata = {{"envconv:layout", "cube"}, {"envconv:note", std::string(length, 'x')}};
    const auto report = write_pictures(path("long.jpg"), one(make(16, 16, 3)), write);
    ASSERT_TRUE(report.ok()) << report.error().message;
    EXPECT_EQ(report->warnings.empty(), length < 65000);
    const auto file = read_pictures(path("long.jpg"), {});
    ASSERT_TRUE(file.ok()) << file.error().message;
    EXPECT_EQ(file->metadata.contains("envconv:layout"), length < 65000);
  }
}

TEST_F(IoOutput, OutputsThatAreNotFiles) {
  ASSERT_EQ(::mkfifo(path("fifo.exr").c_str(), 0600), 0);
  fs::create_directory(path("dir.exr"));
  fs::create_symlink("nowhere.exr", path("dangling.exr"));
  const std::pair<std::string, const char*> cases[] = {{path("fifo.exr"), "regular file"},
                                                       {path("dir.exr"), "directory"},
                                                       {path("dangling.exr"), "leads nowhere"},
                                                       {path("missing/a.exr"), "folder does not exist"}};
  for (const auto& [name, text] : cases) {
    const auto report = write_pictures(name, one(make(4, 4, 3)), {});
    ASSERT_FALSE(report.ok()) << name;
    EXPECT_EQ(report.error().code, ErrorCode::output);
    EXPECT_NE(report.error().message.find(text), std::string::npos) << report.error().message;
  }
  EXPECT_EQ(files_in(folder()), 3);
  // A link to a file stays a link, and its target is what changes.
  fs::create_directory(path("elsewhere"));
  put(path("elsewhere/target.exr"), "old");
  fs::create_symlink("elsewhere/target.exr", path("link.exr"));
  ASSERT_TRUE(write_pictures(path("link.exr"), one(make(4, 4, 3)), {}).ok());
  EXPECT_TRUE(fs::is_symlink(path("link.exr")));
  EXPECT_TRUE(read_pictures(path("elsewhere/target.exr"), {}).ok());
  EXPECT_EQ(files_in(path("elsewhere")), 1);
  // A name as long as names can be.
  EXPECT_TRUE(write_pictures(path(std::string(251, 'n') + ".exr"), one(make(4, 4, 3)), {}).ok());
}

TEST_F(IoOutput, AFullDiskLeavesTheOldContent) {
  const std::string mount = path("disk");
  fs::create_directory(mount);
  if (::mount("tmpfs", mount.c_str(), "tmpfs", 0, "size=64k") != 0) GTEST_SKIP() << "needs the right to mount";
  for (const char* name :
       {"a.exr", "b.exr", "a.hdr", "a.png", "a.tif", "a.jpg", "a.tga", "a.bmp", "a.webp", "a.ppm", "a.pfm"}) {
    const std::string file = mount + "/" + name;
    put(file, "old content");
    WriteOptions write;
    write.type = PixelType::float32;
    if (std::string(name) == "b.exr") write.compression = "none";
    if (std::string(name).find(".jpg") != std::string::npos) write.compression = "100";
    const auto report = write_pictures(file, one(make(700, 400, 3)), write);
    ASSERT_FALSE(report.ok()) << name;
    EXPECT_EQ(report.error().code, ErrorCode::output) << name;
    EXPECT_NE(report.error().message.find("No space left"), std::string::npos) << report.error().message;
    EXPECT_EQ(bytes_of(file), "old content") << name;
    EXPECT_EQ(files_in(mount), 1) << name;
    fs::remove(file);
  }
  for (const char* name : {"levels.tif", "levels.exr"}) {
    std::vector<std::vector<Picture>> levels;
    for (const int width : {700, 350, 175}) levels.push_back(one(make(width, width * 4 / 7, 3)));
    const auto report = write_levels(mount + "/" + name, levels, {});
    ASSERT_FALSE(report.ok()) << name;
    EXPECT_NE(report.error().message.find("No space left"), std::string::npos) << report.error().message;
    EXPECT_EQ(files_in(mount), 0) << name;
  }
  // Full to the last byte: not even the first one can be written.
  put(mount + "/filler", std::string(200000, 'x'));
  for (const char* name : {"a.exr", "a.hdr", "a.png", "a.tif", "a.jpg"}) {
    const auto report = write_pictures(mount + "/" + name, one(make(16, 8, 3)), {});
    ASSERT_FALSE(report.ok()) << name;
    EXPECT_EQ(report.error().code, ErrorCode::output) << report.error().message;
    EXPECT_EQ(files_in(mount), 1) << name;
  }
  EXPECT_EQ(::umount(mount.c_str()), 0);
}

TEST_F(IoOutput, VerificationFindsDamage) {
  for (const char* name : {"a.exr", "a.hdr", "a.tif", "a.png", "a.pfm"}) {
    WriteOptions write;
    write.type = PixelType::float32;
    if (std::string(name) == "a.exr" || std::string(name) == "a.tif") write.compression = "none";
    put(path(name), "old content");
    ::setenv("ENVCONV_TEST_WRITER", "flip", 1);
    write.verify = true;
    const auto report = write_pictures(path(name), one(make(40, 20, 3)), write);
    ::unsetenv("ENVCONV_TEST_WRITER");
    ASSERT_FALSE(report.ok()) << name;
    EXPECT_EQ(report.error().code, ErrorCode::output);
    EXPECT_NE(report.error().message.find("read back"), std::string::npos) << report.error().message;
    EXPECT_EQ(bytes_of(path(name)), "old content");
  }
  EXPECT_EQ(files_in(folder()), 5);
  // In the middle of a file with levels is level 0.
  WriteOptions write;
  write.type = PixelType::float32;
  write.compression = "none";
  write.verify = true;
  ::setenv("ENVCONV_TEST_WRITER", "flip", 1);
  std::vector<std::vector<Picture>> levels;
  for (const int side : {128, 64}) levels.push_back(one(make(side, side, 3)));
  const auto report = write_levels(path("levels.tif"), levels, write);
  ::unsetenv("ENVCONV_TEST_WRITER");
  ASSERT_FALSE(report.ok());
  EXPECT_NE(report.error().message.find("read back"), std::string::npos) << report.error().message;
  EXPECT_EQ(files_in(folder()), 5);
  // Where level 0 is all of one value, and takes next to nothing, it is level 1.
  Picture plain = make(128, 128, 3);
  std::fill_n(plain.image.data(), plain.image.value_count(), 1.f);
  levels[0] = one(std::move(plain));
  // Of several pictures it is none of the first ones.
  std::vector<Picture> faces;
  for (const char* name : {"px", "nx", "py", "ny", "pz", "nz"}) {
    faces.push_back(make(32, 32, 3));
    faces.back().name = name;
  }
  std::vector<std::vector<Picture>> cube;
  cube.push_back(std::move(faces));
  struct Case {
    const char *name, *compression;
    const std::vector<std::vector<Picture>>& all;
  };
  const Case cases[] = {{"levels.tif", "zip", levels},
                        {"levels.exr", "zip", levels},
                        {"faces.exr", "none", cube},
                        {"faces.dds", "", cube},
                        {"faces.ktx2", "", cube}};
  for (const auto& [name, compression, all] : cases) {
    write.compression = compression;
    ASSERT_TRUE(write_levels(path(name), all, write).ok()) << name;
    fs::remove(path(name));
    ::setenv("ENVCONV_TEST_WRITER", "flip", 1);
    const auto damaged = write_levels(path(name), all, write);
    ::unsetenv("ENVCONV_TEST_WRITER");
    ASSERT_FALSE(damaged.ok()) << name;
    EXPECT_NE(damaged.error().message.find("read back"), std::string::npos) << damaged.error().message;
  }
  EXPECT_EQ(files_in(folder()), 5);
}

TEST_F(IoOutput, TemporariesAreRemoved) {
  {
    auto file = OutputFile::create(path("a.exr"));
    ASSERT_TRUE(file.ok());
    file->write("abc", 3);
    EXPECT_EQ(files_in(folder()), 1);
    EXPECT_FALSE(fs::exists(path("a.exr")));
  }
  EXPECT_EQ(files_in(folder()), 0);
  auto file = OutputFile::create(path("a.exr"));
  ASSERT_TRUE(file.ok());
  // As a signal handler would, in a process that then ends: none is made any more.
  EXPECT_EXIT(
      {
        remove_temporaries();
        ::_exit(files_in(folder()) == 0 && !OutputFile::create(path("b.exr")).ok() ? 0 : 1);
      },
      testing::ExitedWithCode(0), "");
  EXPECT_EQ(files_in(folder()), 0);
  file->write("abc", 3);
  EXPECT_FALSE(file->commit().ok());
  // What a killed process left behind goes with the next output of another process, in a folder not seen before.
  fs::create_directory(path("stale"));
  const pid_t child = ::fork();
  if (child == 0) ::_exit(0);
  ::waitpid(child, nullptr, 0);
  const std::string mine = ".envconv-" + std::to_string(::getpid()) + "-0123456789ab.tmp";
  put(path("stale/.envconv-" + std::to_string(child) + "-0123456789ab.tmp"), "x");
  put(path("stale/" + mine), "x");
  put(path("stale/.envconv-notes.tmp"), "x");
  ASSERT_TRUE(write_pictures(path("stale/a.exr"), one(make(4, 4, 3)), {}).ok());
  EXPECT_EQ(files_in(path("stale")), 3);
  EXPECT_TRUE(fs::exists(path("stale/" + mine)));
}

}  // namespace
}  // namespace envconv
