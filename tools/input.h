// SPDX-License-Identifier: Apache-2.0
// An input as the user names it: one file, or one file per face.
#pragma once

#include <string>
#include <vector>

#include "io.h"
#include "options.h"
#include "recognize.h"
#include "result.h"

namespace envconv::tool {

/// The files of one input.
struct Input {
  std::string name;                ///< as given: "sky.exr", "sky_{face}.exr"
  std::vector<std::string> paths;  ///< one, or one per face in the layout's order
  const Layout* layout = nullptr;  ///< whose face names were filled in, or nullptr
};

/// "-" is standard input.  Fills {face} in with the face names of the layout in `hints`, or else of `cube`.  A name
/// that is a file as it stands is that file.
Input input_named(const std::string& name, const InputHints& hints);

/// An error, before anything is read, when a file is missing or not a regular file.
Result<Ok> check_readable(const Input& input);

/// Reads all of an input's files as one: pictures named for their faces.
Result<PictureFile> read_input(const Input& input, const ReadOptions& options);

/// What an input is; recognize() with the hints that the name implies.
Result<Recognition> recognize_input(const Input& input, const PictureFile& file, const InputHints& hints);

/// An input as an environment.
struct LoadedMap {
  std::string name;
  EnvImage image;
  Recognition recognition;
  PixelType type = PixelType::float32;  ///< as stored
  std::vector<std::string> warnings;
};
/// Checks, reads and recognises an input: all of the above in one.
Result<LoadedMap> load_map(const std::string& name, const InputHints& hints, const ReadOptions& options);

/// Whether the stored values are whole numbers, which stand for 0 to 1.
bool is_integer(PixelType type);

}  // namespace envconv::tool
