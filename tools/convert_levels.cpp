// SPDX-License-Identifier: Apache-2.0
#include "convert_levels.h"

#include <algorithm>

#include "options.h"
#include "text.h"

namespace envconv::tool {
namespace {

constexpr int most_levels = 32;

std::string extension_of(const std::string& path) {
  const std::size_t dot = path.rfind('.');
  std::string extension = dot == std::string::npos ? "" : path.substr(dot + 1);
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

// Files that engines load as they are.
bool is_for_engines(const std::string& path) {
  const std::string extension = extension_of(path);
  return extension == "dds" || extension == "ktx" || extension == "ktx2";
}

bool is_apart(const Packing& packing) { return packing.name == "files" || packing.name == "parts"; }

std::string text(Size size) { return std::to_string(size.width) + "x" + std::to_string(size.height); }

// Sizes of the faces of a level as they are stored.
std::vector<Size> stored_sizes(const Layout& layout, int height, int level, const Seam& seam) {
  std::vector<Size> sizes;
  for (int f = 0; f < layout.face_count(); ++f) {
    Size size = level_size(face_size(layout, f, height), level);
    size.width += 2 * seam.gutter(), size.height += 2 * seam.gutter();
    sizes.push_back(size);
  }
  return sizes;
}

// An error where the images of packed faces do not halve from level to level, as those of one file must.
Result<Ok> check_halving(const LevelPlace& place, int height, int levels, const Seam& seam, const std::string& apart) {
  if (is_apart(*place.packing)) return Ok{};
  const std::string extension = extension_of(place.output);
  const std::string packing = extension == "tif" || extension == "tiff" ? "files" : "parts";
  Size first{};
  for (int k = 0; k < levels; ++k) {
    ENVCONV_TRY(const PackedShape shape,
                packed_shape(*place.layout, *place.packing, stored_sizes(*place.layout, height, k, seam)));
    if (k == 0) first = shape.size;
    const Size halved = level_size(first, k);
    if (shape.size != halved)
      return Error{ErrorCode::unsupported,
                   place.output + ": level " + std::to_string(k) + " of the faces makes an image of " +
                       text(shape.size) + ", where the file's must be " + text(halved) + " (--packing " + packing +
                       " keeps the faces apart, a power of two " + "as --size halves, or " + apart + ")"};
  }
  return Ok{};
}

}  // namespace

void add_level_options(Command& command, LevelOptions& target) {
  auto add = [&](Option option, std::string initial = "") {
    command.options.push_back(in_group(std::move(option), "Levels and seams", std::move(initial)));
  };
  Option mips{.names = "--mips",
              .optional_value = "N",
              .help =
                  "MIP levels: the whole chain down to one texel a face, or N levels; in one file, or with {mip} in "
                  "--output in a file each"};
  mips.set = [&target](const std::string& text) {
    target.mips = 0;
    if (text.empty()) return std::string();
    const auto number = parse_integer(text);
    if (!number || *number < 1 || *number > most_levels)
      return "'" + text + "' is not a whole number from 1 to " + std::to_string(most_levels);
    target.mips = static_cast<int>(*number);
    return std::string();
  };
  add(std::move(mips), "off; on for DDS, KTX and KTX2, but for gutters");

  Option filter{.names = "--mip-filter",
                .value = "NAME",
                .help =
                    "how a level's texel is made of level 0: box is the exact mean over its footprint, the others "
                    "read wider, across faces' edges; all keep the mean over the sphere"};
  for (const MipFilter& f : all_mip_filters()) filter.choices.push_back(f.name);
  filter.set = [&target, choices = filter.choices](const std::string& name) {
    target.how.filter = find_mip_filter(name);
    return target.how.filter ? std::string() : "'" + name + "' is not one of " + joined(choices);
  };
  add(std::move(filter), "box");

  Option seam{.names = "--seam",
              .value = "METHOD",
              .help =
                  "for hardware that filters each face alone: average[:WIDTH] makes texels at an edge the mean of "
                  "those that meet there, fading over WIDTH texels; stretch puts texel centres on the edges, where "
                  "neighbours are equal; gutter:TEXELS lets each face grow by true radiance from beyond its edges"};
  for (const SeamKind& kind : all_seam_kinds()) seam.choices.push_back(kind.name);
  seam.set = [&target](const std::string& text) {
    const Result<Seam> parsed = parse_seam(text);
    if (!parsed) return parsed.error().message;
    target.seam = *parsed;
    return std::string();
  };
  add(std::move(seam), "none");

  Option limit{.names = "--max-seam",
               .value = "X",
               .help =
                   "exit with status 1 when the largest seam error of any level, relative to the mean radiance, is "
                   "above X (see envconv info --seams)"};
  limit.set = [&target](const std::string& text) {
    const auto number = parse_number(text);
    if (!number || *number < 0) return "'" + text + "' is not a number of 0 or more";
    target.max_seam = *number;
    return std::string();
  };
  add(std::move(limit));
}

int levels_to_make(const LevelOptions& options, const LevelPlace& place, int height) {
  const int all = level_count(*place.layout, height);
  if (options.mips > 0) return std::min(options.mips, all);
  if (options.mips == 0 || place.file_a_level) return all;
  // As usual: a chain where engines expect one, and the file can hold it.
  const bool chain =
      is_for_engines(place.output) && options.seam.gutter() == 0 && check_halving(place, height, all, options.seam, "");
  return chain ? all : 1;
}

Result<Ok> check_levels(const LevelOptions& options, const LevelPlace& place, int height) {
  const int levels = levels_to_make(options, place, height);
  if (levels == 1 || place.file_a_level) return Ok{};
  const auto refuse = [&](const std::string& what) {
    return Error{ErrorCode::unsupported, place.output + ": " + what};
  };
  const std::string apart = "write one file a level, with {mip} in its name";
  if (options.seam.gutter() > 0)
    return refuse("levels of one file halve, and those of faces with gutters do not (" + apart + ", or --mips=1)");
  if (extension_of(place.output) == "exr" && levels < level_count(*place.layout, height))
    return refuse("OpenEXR holds the whole chain of levels, not " + std::to_string(levels) +
                  " of them (leave out the number of --mips, or " + apart + ")");
  return check_halving(place, height, levels, options.seam, apart);
}

Result<Size> stored_size(const LevelOptions& options, const LevelPlace& place, int height, int level, int face) {
  const std::vector<Size> sizes = stored_sizes(*place.layout, height, level, options.seam);
  if (is_apart(*place.packing)) return sizes[static_cast<std::size_t>(face)];
  ENVCONV_TRY(const PackedShape shape, packed_shape(*place.layout, *place.packing, sizes));
  return shape.size;
}

LevelBytes level_bytes(const LevelOptions& options, const LevelPlace& place, int height, int channels) {
  LevelBytes bytes;
  const auto pixels = [channels](const std::vector<Size>& sizes) {
    std::size_t texels = 0;
    for (const Size& size : sizes)
      texels += static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
    return texels * static_cast<std::size_t>(channels) * sizeof(float);
  };
  MipOptions how = options.how;
  how.levels = levels_to_make(options, place, height);
  for (int k = 1; k < how.levels; ++k) bytes.images += pixels(stored_sizes(*place.layout, height, k, {}));
  if (how.levels > 1) bytes.working = mip_bytes(*place.layout, height, channels, how) - bytes.images;
  const std::vector<Size> grown = stored_sizes(*place.layout, height, 0, options.seam);
  if (options.seam.gutter() > 0) bytes.gutters = pixels(grown);
  if (options.seam.method == SeamMethod::average && options.seam.texels > 1) bytes.seams = pixels(grown);
  return bytes;
}

Result<std::vector<EnvImage>> make_levels(const LevelOptions& options, const LevelPlace& place, EnvImage level0,
                                          int threads) {
  std::vector<EnvImage> levels;
  MipOptions how = options.how;
  how.levels = levels_to_make(options, place, level0.height());
  how.threads = threads;
  if (how.levels > 1) {
    ENVCONV_TRY(levels, make_mips(level0, how));
  }
  levels.insert(levels.begin(), std::move(level0));
  for (EnvImage& level : levels) fix_seams(level, options.seam);
  return levels;
}

WorstSeam worst_seam(const LevelOptions& options, const std::vector<EnvImage>& levels) {
  WorstSeam worst;
  const int gutter = options.seam.gutter();
  for (std::size_t k = 0; k < levels.size(); ++k) {
    const std::vector<Image> grown = gutter ? with_gutters(levels[k], gutter) : std::vector<Image>{};
    const double error = seam_error(levels[k], grown, gutter).largest;
    if (error > worst.error) worst = {error, static_cast<int>(k)};
  }
  return worst;
}

std::vector<LevelFile> level_files(const LevelOptions& options, const LevelPlace& place, std::vector<EnvImage> levels,
                                   PixelType type) {
  const bool a_file_a_face = place.packing->name == "files";
  const std::size_t faces = a_file_a_face ? place.layout->info().faces.size() : 1;
  std::vector<LevelFile> files(place.file_a_level ? faces * levels.size() : faces);
  for (std::size_t k = 0; k < levels.size(); ++k) {
    const std::size_t first = place.file_a_level ? faces * k : 0;
    EnvImage& level = levels[k];
    std::vector<Image> images =
        options.seam.gutter() ? with_gutters(level, options.seam.gutter()) : std::move(level.faces);
    level.faces.clear();
    for (std::size_t f = 0; f < faces; ++f) {
      LevelFile& file = files[first + f];
      if (file.levels.empty()) file.first_level = static_cast<int>(k);
      file.levels.emplace_back();
    }
    if (is_apart(*place.packing)) {
      for (std::size_t f = 0; f < images.size(); ++f) {
        const std::string name = a_file_a_face ? "" : std::string(place.layout->info().faces[f].name);
        files[first + (a_file_a_face ? f : 0)].levels.back().push_back(
            {name, std::move(images[f]), level.channels, type});
      }
      continue;
    }
    std::vector<Size> sizes;
    for (const Image& image : images) sizes.push_back({image.width(), image.height()});
    const Result<PackedShape> shape = packed_shape(*place.layout, *place.packing, sizes);
    files[first].levels.back().push_back({"", pack(*shape, std::move(images)), level.channels, type});
  }
  return files;
}

}  // namespace envconv::tool
