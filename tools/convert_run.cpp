// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <new>
#include <system_error>
#include <thread>
#include <utility>

#include "convert.h"
#include "pixels.h"
#include "scratch.h"
#include "text.h"

namespace envconv::tool {
namespace {

// "1 value is", "2 values are"
std::string counted(std::int64_t n) { return std::to_string(n) + (n == 1 ? " value is" : " values are"); }

// The rotation whose matrix is rotation_matrix(second) * rotation_matrix(first).
Rotation composed(const Rotation& first, const Rotation& second) {
  if (first == Rotation{}) return second;
  if (second == Rotation{}) return first;
  // M = Y(yaw) X(pitch) Z(roll); its second row is (cos p sin r, cos p cos r, -sin p), its third column
  // (cos p sin y, -sin p, cos p cos y).
  const std::array<double, 9> m = (rotation_matrix(second) * rotation_matrix(first)).m;
  constexpr double degrees = 180 / 3.14159265358979323846;
  Rotation r;
  r.pitch = degrees * std::asin(std::fmin(1, std::fmax(-1, -m[5])));
  if (std::abs(m[5]) < 1 - 1e-12) {
    r.yaw = degrees * std::atan2(m[2], m[8]);
    r.roll = degrees * std::atan2(m[3], m[4]);
  } else {
    r.yaw = degrees * std::atan2(-m[6], m[0]);  // looking straight up or down, roll is yaw
  }
  for (double* angle : {&r.yaw, &r.pitch, &r.roll}) *angle = std::round(*angle * 1e9) / 1e9 + 0.0;
  return r;
}

// The error of a step that does not know the file.
template <class T>
Result<T> named(const Job& job, Result<T> result) {
  if (result) return result;
  const ErrorCode code = result.error().code;
  return Error{code == ErrorCode::usage ? ErrorCode::unsupported : code,
               job.input.name + ": " + result.error().message};
}

// When a file was last written; nothing when it is not there.
std::optional<std::filesystem::file_time_type> time_of(const std::string& path) {
  std::error_code error;
  const auto time = std::filesystem::last_write_time(path, error);
  return error ? std::nullopt : std::optional(time);
}

// True when a file is what would be written: size, levels, and type as far as it is chosen; and, of formats that tell
// it, layout, packing, frame, rotation and seam.
bool is_as_planned(const ConvertPlan& plan, const Job& job, const Shape& shape, std::size_t number,
                   const PictureFile& file) {
  const ConvertOptions& o = plan.options;
  const std::size_t faces = o.packing->name == "files" ? o.layout->info().faces.size() : 1;
  const int level = job.file_a_level ? static_cast<int>(number / faces) : 0;
  const LevelPlace place = level_place(plan, job);
  const Result<Size> size = stored_size(o.levels, place, shape.height, level, static_cast<int>(number % faces));
  const Picture& first = file.pictures.front();
  if (!size || first.image.width() != size->width || first.image.height() != size->height) return false;
  if (static_cast<int>(file.pictures.size()) != pictures_of(plan)) return false;
  // OpenEXR counts its levels by the larger side of the image, which may hold many faces.
  const int levels = levels_in_file(plan, job, shape.height);
  if (file.format == "openexr" ? (file.levels > 1) != (levels > 1) : file.levels != levels) return false;
  if (o.write.type_given && first.type != o.write.type) return false;
  if (!file.metadata.contains("envconv:layout")) return true;
  const Metadata planned =
      write_options(plan, job, shape, composed(shape.source.rotation, o.rotation), first.type).metadata;
  // What is usual may be left out; of a rotation that is not told nothing is known.
  const auto told = [](const Metadata& metadata, const char* name) -> std::string {
    const auto found = metadata.find(name);
    if (found != metadata.end()) return found->second;
    return std::string_view(name) == "envconv:frame" ? "world" : "";
  };
  for (const char* name : {"envconv:layout", "envconv:packing", "envconv:rotation"}) {
    if (file.metadata.contains(name) && told(file.metadata, name) != told(planned, name)) return false;
  }
  return told(file.metadata, "envconv:frame") == told(planned, "envconv:frame") &&
         told(file.metadata, "envconv:seam") == told(planned, "envconv:seam");
}

// True when every output of the job is there, no older than the input, is what would be written, and can be read to its
// end.
bool is_up_to_date(const ConvertPlan& plan, const Job& job) {
  ReadOptions read = plan.options.input.read;
  read.level = 0;
  for (const std::string& path : job.paths) {
    const auto written = time_of(path);
    if (!written) return false;
    for (const std::string& input : job.input.paths) {
      const auto changed = time_of(input);
      if (changed && *changed > *written) return false;
    }
  }
  const Result<Shape> shape = read_shape(plan, job);
  if (!shape) return false;
  for (std::size_t i = 0; i < job.paths.size(); ++i) {
    const Result<PictureFile> file = read_pictures(job.paths[i], read);
    if (!file || file->pictures.empty() || !is_as_planned(plan, job, *shape, i, *file)) return false;
  }
  return true;
}

Result<Ok> treat_nonfinite(const ConvertPlan& plan, const Job& job, EnvImage& image,
                           std::vector<std::string>& warnings) {
  std::int64_t count = 0, values = 0;
  for (const Image& face : image.faces) {
    count += count_nonfinite(face);
    values += std::int64_t{face.width()} * face.height() * face.channels();
  }
  if (count == 0) return Ok{};
  const std::string what = counted(count) + " NaN or infinite";
  std::string done;
  switch (plan.options.nonfinite) {
    case Nonfinite::error:
      return Error{ErrorCode::input, job.input.name + ": " + what + " (--nonfinite repair, zero or clamp goes on)"};
    case Nonfinite::zero:
      for (Image& face : image.faces) zero_nonfinite(face);
      done = "set to 0";
      break;
    case Nonfinite::clamp:
      for (Image& face : image.faces) clamp_nonfinite(face);
      done = "clamped";
      break;
    case Nonfinite::repair:
      if (count == values)
        return Error{ErrorCode::input, job.input.name + ": has no finite value (--nonfinite zero or clamp goes on)"};
      for (Image& face : image.faces) repair_nonfinite(face);
      done = "replaced by the mean of the neighbours";
      break;
  }
  warnings.push_back(what + ": " + done + " (--nonfinite says what to do)");
  return Ok{};
}

void change_values(const ConvertOptions& o, EnvImage& image) {
  if (o.exposure == 0) return;
  const auto factor = static_cast<float>(std::exp2(o.exposure));
  for (Image& face : image.faces) scale_color(face, image.channels.alpha, factor);
}

// What the format could not hold, in words.
void warn_of(const WriteReport& report, const std::string& path, std::vector<std::string>& warnings) {
  const std::string format = std::string(name_of(report.type)) + " " + std::filesystem::path(path).extension().string();
  if (report.clamped_high > 0) {
    warnings.push_back(counted(report.clamped_high) + " too large for " + format + ": clamped");
  }
  if (report.clamped_negative > 0) {
    warnings.push_back(counted(report.clamped_negative) + " negative, which " + format + " cannot hold: set to 0");
  }
  if (report.nonfinite > 0) warnings.push_back(counted(report.nonfinite) + " NaN or infinite in the result: replaced");
  warnings.insert(warnings.end(), report.warnings.begin(), report.warnings.end());
}

// Formats without names for channels take them for grey, colour and alpha, whatever they are.
void warn_of_names(const Channels& channels, const std::string& path, std::vector<std::string>& warnings) {
  constexpr std::array<std::array<std::string_view, 4>, 4> usual{
      {{"Y"}, {"Y", "A"}, {"R", "G", "B"}, {"R", "G", "B", "A"}}};
  const auto count = static_cast<std::size_t>(channels.count());
  const std::string extension = std::filesystem::path(path).extension().string();
  if (count < 1 || count > usual.size() || extension == ".exr") return;
  const auto& wanted = usual[count - 1];
  if (std::equal(channels.names.begin(), channels.names.end(), wanted.begin())) return;
  std::string from, to;
  for (std::size_t i = 0; i < count; ++i) {
    from += (i > 0 ? " " : "") + channels.names[i];
    to += (i > 0 ? " " : "") + std::string(wanted[i]);
  }
  warnings.push_back("channels " + from + " are taken for " + to + ", as " + extension + " has no names for them");
}

// The nearest type that the format of `path` has: the source's own, another of its kind, or else what there is.
PixelType nearest_type(const std::string& path, PixelType source, WriteOptions write, int parts, int channels,
                       int levels) {
  using enum PixelType;
  std::vector<PixelType> order{source};
  if (source == half || source == float32 || source == r11g11b10f || source == rgb9e5 || source == bc6h) {
    order.insert(order.end(), {float32, half, uint8, uint16});
  } else if (source == uint8) {
    order.insert(order.end(), {half, float32, uint16});
  } else {
    order.insert(order.end(), {uint16, half, float32, uint8});
  }
  write.type_given = true;
  for (const PixelType type : order) {
    write.type = type;
    if (can_write(path, write, parts, channels, levels)) return type;
  }
  return source;
}

}  // namespace

WriteOptions write_options(const ConvertPlan& plan, const Job& job, const Shape& shape, const Rotation& rotation,
                           PixelType source_type) {
  const ConvertOptions& o = plan.options;
  WriteOptions write = o.write;
  write.threads = o.threads;
  RecordedLevels recorded{o.levels.seam, 0, 0};
  if (recorded.seam.gutter() > 0 || shape.levels > 1) recorded.height = shape.height;
  write.metadata = metadata_of(*o.layout, *o.packing, *o.frame, rotation, recorded);
  const int channels = shape.channels, in_file = levels_in_file(plan, job, shape.height);
  if (!write.type_given) {
    write.type = nearest_type(job.paths.front(), source_type, write, pictures_of(plan), channels, in_file);
    write.type_given = true;
  }
  return write;
}

Result<Ok> write_files(const ConvertPlan& plan, const Job& job, const WriteOptions& write, std::vector<EnvImage> levels,
                       Outcome& outcome) {
  const Channels named_channels = levels.front().channels;
  const int channels = named_channels.count(), in_file = levels_in_file(plan, job, outcome.shape.height);
  const std::vector<LevelFile> files =
      level_files(plan.options.levels, level_place(plan, job), std::move(levels), write.type);
  for (const std::string& path : job.paths) {
    ENVCONV_CHECK(can_write(path, write, pictures_of(plan), channels, in_file));
  }
  warn_of_names(named_channels, job.paths.front(), outcome.warnings);
  WriteReport total;
  for (std::size_t i = 0; i < files.size(); ++i) {
    WriteOptions one = write;
    if (files[i].first_level > 0) one.metadata["envconv:level"] = std::to_string(files[i].first_level);
    ENVCONV_TRY(const WriteReport report, write_levels(job.paths[i], files[i].levels, one));
    total.type = report.type;
    total.clamped_high += report.clamped_high;
    total.clamped_negative += report.clamped_negative;
    total.nonfinite += report.nonfinite;
    if (i == 0) total.warnings = report.warnings;
  }
  // A display is as bright as it is; values beyond that are the view's doing.
  if (write.metadata.contains("envconv:view")) total.clamped_high = total.clamped_negative = 0;
  outcome.type = total.type;
  warn_of(total, job.paths.front(), outcome.warnings);
  return Ok{};
}

namespace {

// Seconds since the last call, or since it was made.
class StopWatch {
 public:
  double lap() {
    const Clock::time_point before = std::exchange(last_, Clock::now());
    return std::chrono::duration<double>(last_ - before).count();
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point last_ = Clock::now();
};

// One job between its stages.
class Conversion {
 public:
  Conversion(const ConvertPlan& plan, const Job& job, Batch::Turn& turn)
      : plan_(plan), o_(plan.options), job_(job), turn_(turn) {}

  // Bytes that were thought to suffice; 0 before that was known.
  std::size_t needed() const { return needed_; }
  const std::shared_ptr<Scratch>& scratch() const { return scratch_; }

  Result<Outcome> run() {
    if (o_.skip_existing && is_up_to_date(plan_, job_)) {
      outcome_.skipped = true;
      return outcome_;
    }
    ENVCONV_CHECK(read());
    if (turn_.cancelled()) return cancelled;
    ENVCONV_CHECK(change_layout());
    if (turn_.cancelled()) return cancelled;
    ENVCONV_CHECK(write());
    return judged();
  }

 private:
  // Memory is reserved as soon as the header tells how much, before there are any pixels.
  Result<Ok> reserve(const PictureFile& header) {
    ENVCONV_TRY(outcome_.shape, shape_of(plan_, job_, header));
    ENVCONV_CHECK(check_memory(plan_, job_, outcome_.shape));
    const MemoryPlan& memory = outcome_.shape.memory;
    // Scratch storage leaves in memory what there is room for: all that is allowed.
    const std::size_t bytes = memory.scratch > 0 ? turn_.memory() : memory.peak;
    watch_.lap();
    if (!turn_.reserve(bytes)) return cancelled;
    needed_ = memory.needed;
    waited_ += watch_.lap();
    if (memory.scratch > 0) scratch_ = std::make_shared<Scratch>(memory.folder, memory.resident);
    prepare_room(header);
    return Ok{};
  }

  // The result's pages, which take the system time to make, come into being while the source is decoded: not where
  // that needs the memory itself, to take a picture apart.
  void prepare_room(const PictureFile& header) {
    const Recognition& source = outcome_.shape.source;
    if (scratch_ || turn_.threads() < 2 || header.pictures.size() != 1 || source.layout->face_count() > 1) return;
    if (source.layout == o_.layout) return;  // it may be taken as it is
    constexpr std::size_t worth_a_thread = std::size_t{8} << 20;
    if (outcome_.shape.result_bytes < worth_a_thread) return;
    try {
      room_ready_ = std::jthread([this] { make_room(); });
    } catch (const std::system_error&) {
      // There are no more threads to be had.
    }
  }

  void make_room() {
    constexpr std::size_t page = 4096 / sizeof(float);
    try {
      for (const Size& size : outcome_.shape.faces) {
        Image face(size.width, size.height, outcome_.shape.channels);
        for (std::size_t i = 0; i < face.value_count(); i += page) face.data()[i] = 0;
        room_.faces.push_back(std::move(face));
      }
    } catch (const std::bad_alloc&) {
      room_.faces.clear();  // it is asked for again
    }
  }

  Result<Ok> read() {
    StopWatch whole;
    ReadOptions read = with_color(o_.input.read, plan_.color, job_.input.paths.front());
    read.threads = turn_.threads();
    if (job_.input.layout) {  // the shape takes all of the input's files
      read.header_only = true;
      ENVCONV_TRY(const PictureFile header, read_input(job_.input, read));
      ENVCONV_CHECK(reserve(header));
      read.header_only = false;
      read.scratch = scratch_;
    } else {
      read.accept = [this, &read](const PictureFile& header) {
        const Result<Ok> accepted = reserve(header);
        read.scratch = scratch_;
        return accepted;
      };
    }
    ENVCONV_TRY(PictureFile file, read_input(job_.input, read));
    if (file.pictures.empty()) return Error{ErrorCode::input, job_.input.name + ": holds no picture"};
    outcome_.warnings = file.warnings;
    const Recognition& source = outcome_.shape.source;
    outcome_.warnings.insert(outcome_.warnings.end(), source.warnings.begin(), source.warnings.end());
    const PixelType source_type = file.pictures.front().type;
    ENVCONV_TRY(image_, to_environment(std::move(file), source));
    ENVCONV_CHECK(treat_nonfinite(plan_, job_, image_, outcome_.warnings));
    ENVCONV_CHECK(named(job_, to_working(plan_.color, outcome_.shape.color, image_.channels, image_.faces)));
    change_values(o_, image_);
    write_ = write_options(plan_, job_, outcome_.shape, composed(source.rotation, o_.rotation), source_type);
    const float peak = wants_peak(plan_.color, source_type, write_.type) ? largest_color(image_) : 0;
    output_ = output_color(plan_.color, image_.channels, write_.type, peak);
    if (output_.is_preview) {
      outcome_.warnings.push_back("values up to " + number_text(static_cast<double>(peak), 6) + " are shown through " +
                                  view_text(*output_.view) + " (--view none clips them)");
    }
    outcome_.read_seconds = whole.lap() - waited_;
    return Ok{};
  }

  Result<Ok> change_layout() {
    ResampleOptions options;
    options.layout = o_.layout;
    options.height = outcome_.shape.height;
    options.placement = placement_for(*o_.layout, o_.levels.seam);
    options.consumer_from_world = o_.frame->consumer_from_world;
    options.rotation = o_.rotation;
    options.filter = o_.filter;
    options.samples = o_.samples;
    const std::int64_t texels = texel_count(*o_.layout, outcome_.shape.height);
    options.progress = [this, texels](double share) {
      if (scratch_) scratch_->relieve();
      turn_.advance(share, static_cast<double>(texels));
      return !turn_.cancelled();
    };
    options.threads = turn_.take_cores(texels + static_cast<std::int64_t>(image_.texel_count()));
    watch_.lap();
    if (room_ready_.joinable()) room_ready_.join();
    EnvImage room = scratch_ ? room_for_result() : std::move(room_);
    Result<EnvImage> result = named(job_, resample(std::move(image_), options, std::move(room)));
    outcome_.resample_seconds = watch_.lap();
    turn_.release_cores();
    if (!result) return turn_.cancelled() ? cancelled : result.error();
    turn_.advance(1, static_cast<double>(texels));
    image_ = std::move(*result);
    return Ok{};
  }

  EnvImage room_for_result() const {
    EnvImage room;
    for (const Size& size : outcome_.shape.faces)
      room.faces.push_back(image_.faces.front().sibling(size.width, size.height, image_.channels.count()));
    return room;
  }

  Result<Ok> write() {
    watch_.lap();
    waited_ = 0;
    write_.before_commit = [this]() -> Result<Ok> {
      StopWatch waiting;
      const bool wanted = turn_.may_commit();
      waited_ += waiting.lap();
      return wanted ? Result<Ok>(Ok{}) : cancelled;
    };
    // Levels are means of linear light: colours are encoded after them.
    ENVCONV_TRY(std::vector<EnvImage> levels,
                named(job_, make_levels(o_.levels, level_place(plan_, job_), std::move(image_), turn_.threads())));
    if (o_.levels.max_seam) outcome_.seam = worst_seam(o_.levels, levels);
    for (EnvImage& level : levels) {
      ENVCONV_CHECK(named(job_, to_output(plan_.color, output_, outcome_.shape.color, level, write_)));
    }
    outcome_.color = write_.color.space;
    ENVCONV_CHECK(write_files(plan_, job_, write_, std::move(levels), outcome_));
    outcome_.write_seconds = watch_.lap() - waited_;
    return Ok{};
  }

  // The outcome, or the threshold that it fails.
  Result<Outcome> judged() const {
    if (!outcome_.seam || outcome_.seam->error <= *o_.levels.max_seam) return outcome_;
    return Error{ErrorCode::threshold, job_.output + ": the largest seam error is " +
                                           number_text(outcome_.seam->error, 4) + ", at level " +
                                           std::to_string(outcome_.seam->level) + ", above --max-seam " +
                                           number_text(*o_.levels.max_seam, 9)};
  }

  const ConvertPlan& plan_;
  const ConvertOptions& o_;
  const Job& job_;
  Batch::Turn& turn_;
  Outcome outcome_;
  EnvImage image_;  // the source, then the result
  WriteOptions write_;
  OutputColor output_;
  std::size_t needed_ = 0;
  std::shared_ptr<Scratch> scratch_;  // for images that do not fit into memory
  StopWatch watch_;
  double waited_ = 0;
  EnvImage room_;            // for the result, when the thread has ended
  std::jthread room_ready_;  // that makes it
};

}  // namespace

const Error cancelled{ErrorCode::output, ""};

Result<Outcome> run_job(const ConvertPlan& plan, const Job& job, Batch::Turn& turn) {
  if (job.error) return *job.error;
  Conversion conversion(plan, job, turn);
  Result<Outcome> outcome = cancelled;
  try {
    outcome = conversion.run();
  } catch (const std::bad_alloc&) {
    outcome = Error{ErrorCode::limit, job.input.name + ": not enough memory"};
  }
  if (!outcome && outcome.error().code == ErrorCode::limit && conversion.scratch()) {
    // The storage's own reason, where it was that.
    if (const std::optional<Error> full = conversion.scratch()->failure()) {
      return Error{full->code, job.output + ": " + full->message, full->system};
    }
  }
  const std::size_t needed = conversion.needed();
  if (!outcome && outcome.error().code == ErrorCode::limit && needed > 0) {
    return Error{ErrorCode::limit, outcome.error().message + "; about " + megabytes(needed) +
                                       " are needed (a smaller --size needs less)"};
  }
  return outcome;
}

}  // namespace envconv::tool
