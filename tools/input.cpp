// SPDX-License-Identifier: Apache-2.0
#include "input.h"

#include <sys/stat.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "layout.h"
#include "standard_input.h"

namespace envconv::tool {
namespace {

constexpr std::string_view face_field = "{face}";

std::string with_face(const std::string& name, std::string_view face) {
  std::string path = name;
  for (std::size_t at = 0; (at = path.find(face_field, at)) != std::string::npos; at += face.size()) {
    path.replace(at, face_field.size(), face);
  }
  return path;
}

std::string recorded_space(const PictureFile& file) {
  const auto record = file.metadata.find("envconv:colorspace");
  return record == file.metadata.end() ? "" : record->second;
}

// Nobody needs to know where it was kept.
Result<PictureFile> read_standard_input(const ReadOptions& options) {
  const auto renamed = [](Error error) {
    error.message = with_standard_input_named(std::move(error.message));
    return error;
  };
  Result<PictureFile> file = read_pictures(standard_input_path(), options);
  if (!file) return renamed(file.error());
  file->path = standard_input;
  for (std::string& warning : file->warnings) warning = with_standard_input_named(std::move(warning));
  return file;
}

}  // namespace

Input input_named(const std::string& name, const InputHints& hints) {
  struct stat status;
  if (name == standard_input) return {name, {standard_input_path()}, nullptr};
  if (name.find(face_field) == std::string::npos || stat(name.c_str(), &status) == 0) return {name, {name}, nullptr};
  Input input{name, {}, hints.layout ? hints.layout : find_layout("cube")};
  for (const Face& face : input.layout->info().faces) input.paths.push_back(with_face(name, face.name));
  return input;
}

Result<Ok> check_readable(const Input& input) {
  if (input.name == standard_input) return keep_standard_input();
  for (const std::string& path : input.paths) {
    if (path.empty()) return Error{ErrorCode::input, "\"\": an empty name is no file"};
    struct stat status;
    if (stat(path.c_str(), &status) != 0) {
      std::string text = path + ": cannot be read: " + std::strerror(errno);
      if (input.layout) text += " (the " + std::string(input.layout->name()) + "'s faces are wanted, one file each)";
      return Error{ErrorCode::input, text};
    }
    if (!S_ISREG(status.st_mode)) return Error{ErrorCode::input, path + ": not a regular file"};
  }
  return Ok{};
}

Result<PictureFile> read_input(const Input& input, const ReadOptions& options) {
  if (input.name == standard_input) return read_standard_input(options);
  if (!input.layout) return read_pictures(input.paths.front(), options);
  PictureFile all;
  for (std::size_t i = 0; i < input.paths.size(); ++i) {
    ENVCONV_TRY(PictureFile one, read_pictures(input.paths[i], options));
    if (one.pictures.size() != 1) {
      return Error{ErrorCode::input, input.paths[i] + ": holds " + std::to_string(one.pictures.size()) +
                                         " pictures, where the one of a face was expected"};
    }
    Picture picture = std::move(one.pictures.front());
    picture.name = input.layout->info().faces[i].name;
    if (i == 0) {
      all = std::move(one);
      all.pictures.clear();
      all.path = input.name;
    } else {
      all.warnings.insert(all.warnings.end(), one.warnings.begin(), one.warnings.end());
      const Image& first = all.pictures.front().image;
      if (faces_are_alike(*input.layout) &&
          (picture.image.width() != first.width() || picture.image.height() != first.height())) {
        return Error{ErrorCode::input, input.paths[i] + ": " + std::to_string(picture.image.width()) + "x" +
                                           std::to_string(picture.image.height()) + ", where " + input.paths[0] +
                                           " is " + std::to_string(first.width()) + "x" +
                                           std::to_string(first.height())};
      }
      // With as_stored, the caller knows better than the files.
      if (!options.as_stored &&
          (one.as_stored != all.as_stored || one.color_encoding.primaries != all.color_encoding.primaries ||
           recorded_space(one) != recorded_space(all))) {
        return Error{ErrorCode::input, input.paths[i] + ": its colour space is not that of " + input.paths[0] +
                                           " (--in-colorspace says which it is)"};
      }
      if (picture.channels != all.pictures.front().channels) {
        return Error{ErrorCode::input, input.paths[i] + ": its channels are not those of " + input.paths[0]};
      }
    }
    all.pictures.push_back(std::move(picture));
  }
  return all;
}

Result<Recognition> recognize_input(const Input& input, const PictureFile& file, const InputHints& hints) {
  InputHints all = hints;
  if (input.layout) {
    if (!all.packing) all.packing = find_packing("files");
    // Face names are shared by a family, so the metadata may know better than the default did.
    if (!all.layout && !file.metadata.contains("envconv:layout")) all.layout = input.layout;
  }
  return recognize(file, all);
}

bool is_integer(PixelType type) {
  return type == PixelType::uint8 || type == PixelType::uint16 || type == PixelType::uint32;
}

Result<LoadedMap> load_map(const std::string& name, const InputHints& hints, const ReadOptions& options) {
  const Input input = input_named(name, hints);
  ENVCONV_CHECK(check_readable(input));
  ENVCONV_TRY(PictureFile file, read_input(input, options));
  if (file.pictures.empty()) return Error{ErrorCode::input, name + ": holds no picture"};
  LoadedMap map;
  map.name = name;
  map.type = file.pictures.front().type;
  map.warnings = file.warnings;
  ENVCONV_TRY(map.recognition, recognize_input(input, file, hints));
  map.warnings.insert(map.warnings.end(), map.recognition.warnings.begin(), map.recognition.warnings.end());
  ENVCONV_TRY(map.image, to_environment(std::move(file), map.recognition));
  return map;
}

}  // namespace envconv::tool
