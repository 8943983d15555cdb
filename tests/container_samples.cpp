// SPDX-License-Identifier: Apache-2.0
// Writes maps of directions in every layout whose faces are alike, container and type, with all levels, for
// container_oracle_test.py to read: container_samples FOLDER.  A texel's colour is 0.5 + 0.45 (x, y, z) of the
// direction of its centre.  LAYOUT.expected has the same without any container: for each level and face width and
// height as 32-bit integers, then rows of RGB floats.
#include <cstdio>
#include <fstream>

#include "envconv.h"

namespace {

using namespace envconv;

Picture directions(const Layout& layout, int face, int width, int height) {
  Picture picture;
  picture.channels = Channels::standard(3);
  picture.image = Image(width, height, 3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const Vec3 d = layout.direction(face, (x + 0.5) / width, (y + 0.5) / height);
      const double xyz[3] = {d.x, d.y, d.z};
      for (int c = 0; c < 3; ++c) picture.image.at(x, y)[c] = static_cast<float>(0.5 + 0.45 * xyz[c]);
    }
  }
  return picture;
}

std::vector<std::vector<Picture>> all_levels(const Layout& layout) {
  const Size base = face_size(layout, 0, 6);
  std::vector<std::vector<Picture>> levels;
  for (int level = 0; std::max(base.width, base.height) >> level > 0; ++level) {
    std::vector<Picture>& faces = levels.emplace_back();
    for (int face = 0; face < layout.face_count(); ++face) {
      faces.push_back(directions(layout, face, std::max(1, base.width >> level), std::max(1, base.height >> level)));
    }
  }
  return levels;
}

void write_expected(const std::string& path, const std::vector<std::vector<Picture>>& levels) {
  std::ofstream out(path, std::ios::binary);
  for (const std::vector<Picture>& level : levels) {
    for (const Picture& picture : level) {
      const std::int32_t size[2] = {picture.image.width(), picture.image.height()};
      out.write(reinterpret_cast<const char*>(size), sizeof size);
      out.write(reinterpret_cast<const char*>(picture.image.data()),
                static_cast<std::streamsize>(picture.image.value_count() * sizeof(float)));
    }
  }
}

}  // namespace

int main(int count, char** words) {
  if (count != 2) return 2;
  const std::string folder = words[1];
  for (const Layout& layout : all_layouts()) {
    if (!faces_are_alike(layout)) continue;
    const auto levels = all_levels(layout);
    const std::string stem = folder + "/" + std::string(layout.name()) + ".";
    write_expected(stem + "expected", levels);
    WriteOptions options;
    options.type_given = true;
    options.cube = is_cube_map(layout);
    options.metadata = metadata_of(layout, *find_packing("parts"), *find_frame("world"), {});
    for (const char* container : {"dds", "ktx", "ktx2", "zstd.ktx2", "zlib.ktx2"}) {
      using enum PixelType;
      const std::string_view name = container;
      options.compression = name == "zstd.ktx2" ? "zstd" : name == "zlib.ktx2" ? "zlib" : "";
      for (const PixelType type : {half, float32, uint8, r11g11b10f, rgb9e5, bc6h}) {
        options.type = type;
        const auto report = write_levels(stem + std::string(name_of(type)) + "." + container, levels, options);
        if (!report) {
          std::fprintf(stderr, "%s\n", report.error().message.c_str());
          return 1;
        }
      }
    }
  }
  return 0;
}
