// SPDX-License-Identifier: Apache-2.0
// Conversion in three steps: options as typed, a plan that is pure data, and the work.  Whatever can be found wrong
// without reading a pixel is found by the plan.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "batch.h"
#include "color_options.h"
#include "convert_levels.h"
#include "input.h"
#include "io.h"
#include "options.h"
#include "output_name.h"
#include "resample.h"

namespace envconv::tool {

/// Bounds of --size: the size of a face that any consumer can hold, with room to spare.
inline constexpr int least_size = 1, largest_size = 65536;

/// What becomes of NaN and infinity.
enum class Nonfinite { error, zero, clamp, repair };

/// The options of `convert`.
struct ConvertOptions {
  InputOptions input;
  std::string output;
  const Layout* layout = nullptr;    ///< nullptr: cube
  const Packing* packing = nullptr;  ///< nullptr: the layout's own
  const Frame* frame = nullptr;      ///< nullptr: world
  Rotation rotation;
  int size = 0;             ///< 0: auto
  std::int64_t texels = 0;  ///< 0: not given
  const Filter* filter = nullptr;
  int samples = 0;
  LevelOptions levels;
  WriteOptions write;  ///< type_given tells whether --type was
  ColorOptions color;
  double exposure = 0;
  Nonfinite nonfinite = Nonfinite::repair;
  int threads = 0;
  std::int64_t memory = 0;      ///< bytes; 0: three quarters of what is available
  std::string files_from;       ///< a file with names of inputs, "-" for standard input; "": none
  bool null_separated = false;  ///< its names end with a zero byte, not with a line
  int shard = 1, shards = 1;    ///< every shards-th input from the shard-th on
  bool skip_existing = false, keep_going = false, dry_run = false, json = false;
  std::string progress = "auto";
};

/// One input and its outputs.
struct Job {
  Input input;
  int index = 0;                   ///< in the whole batch, of which a shard takes a part
  std::string output;              ///< as it is named in messages: for face files with {face} left in
  std::vector<std::string> paths;  ///< files to write: one, or one per face, for each level that has files of its own
  bool file_a_level = false;       ///< {mip} is in their names
  std::optional<Error> error;      ///< found while planning; set only with keep_going
};

/// What will be done.
struct ConvertPlan {
  ConvertOptions options;  ///< with layout, packing, frame, threads and memory filled in
  ColorPlan color;
  std::vector<Job> jobs;  ///< of the shard
  bool is_batch = false;  ///< what was asked for is a batch, if only of one input
};

/// The inputs that were named one by one, then those of --files-from, whatever the shard.
Result<std::vector<std::string>> all_inputs(const ConvertOptions& options, std::vector<std::string> named);

/// Makes the plan and checks all of it.
Result<ConvertPlan> make_plan(ConvertOptions options, const std::vector<std::string>& inputs);

/// The plan of one output that has no input: `name` is its stem, and stands for it in messages.
Result<ConvertPlan> plan_output(ConvertOptions options, const std::string& name);

/// What a conversion takes of memory.
struct MemoryPlan {
  std::size_t peak = 0;      ///< bytes that the process will hold at most, this file being its only one
  std::size_t needed = 0;    ///< the least --memory that allows the conversion
  std::size_t scratch = 0;   ///< bytes of a disk that images will take when they do not fit; 0: they are in memory
  std::string folder;        ///< where those are
  std::size_t resident = 0;  ///< what Scratch is told then
};

/// What an input is and what it will become; all that a header tells.
struct Shape {
  Recognition source;
  Size image;  ///< of the input's first picture
  int channels = 0;
  SourceColor color;
  int height = 0;  ///< of the output's face 0
  std::vector<Size> faces;
  int levels = 1;
  std::size_t source_bytes = 0, result_bytes = 0;  ///< of pixels, as floats
  MemoryPlan memory;
};
/// The folder that a path lies in, "." when it has none.
std::string folder_of(const std::string& path);

/// Where a job's levels go.
LevelPlace level_place(const ConvertPlan& plan, const Job& job);
/// Pictures and levels of each of its files.
int pictures_of(const ConvertPlan& plan);
int levels_in_file(const ConvertPlan& plan, const Job& job, int height);

/// Errors: limit when the output would be too large.
Result<Shape> shape_of(const ConvertPlan& plan, const Job& job, const PictureFile& file);
/// The same from the file's header alone.
Result<Shape> read_shape(const ConvertPlan& plan, const Job& job);

/// What such a file takes at its highest, reading, resampling or writing; and whether its images stay in memory.
MemoryPlan plan_memory(const ConvertPlan& plan, const Job& job, const Shape& shape, const PictureFile& file);

/// An error, of ErrorCode::limit, when that is more than --memory allows.
Result<Ok> check_memory(const ConvertPlan& plan, const Job& job, const Shape& shape);

/// What was done.
struct Outcome {
  Shape shape;
  bool skipped = false;
  std::optional<WorstSeam> seam;  ///< measured with --max-seam
  PixelType type = PixelType::half;
  std::string color;  ///< colour space of the output, or ""
  std::vector<std::string> warnings;
  double read_seconds = 0, resample_seconds = 0, write_seconds = 0;  ///< without waiting for cores or memory
};

/// How the outputs are written: with metadata that record `rotation`, and without --type as the format's nearest to
/// `source_type`.
WriteOptions write_options(const ConvertPlan& plan, const Job& job, const Shape& shape, const Rotation& rotation,
                           PixelType source_type);
/// Packs an environment's levels and writes them as planned.  Sets the outcome's type, and adds to its warnings.
Result<Ok> write_files(const ConvertPlan& plan, const Job& job, const WriteOptions& write, std::vector<EnvImage> levels,
                       Outcome& outcome);

/// Converts one input, in its turn.  The error of a job that is not wanted any more is `cancelled`.
Result<Outcome> run_job(const ConvertPlan& plan, const Job& job, Batch::Turn& turn);
extern const Error cancelled;

/// Converts all of them, or with --dry-run says what would be done; gives back the exit status.
int run_plan(const ConvertPlan& plan);

}  // namespace envconv::tool
