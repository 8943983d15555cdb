// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <filesystem>
#include <new>

#include "convert.h"
#include "pixels.h"
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

// True when every output of the job is there and can be read to its end.
bool is_complete(const ConvertPlan& plan, const Job& job) {
  for (const std::string& path : job.paths) {
    std::error_code error;
    if (!std::filesystem::exists(path, error)) return false;
    ReadOptions read = plan.options.input.read;
    read.level = 0;  // of the output, whichever is taken of the input
    if (!read_pictures(path, read)) return false;
  }
  return true;
}

Result<Ok> treat_nonfinite(const ConvertPlan& plan, const Job& job, EnvImage& image,
                           std::vector<std::string>& warnings) {
  std::int64_t count = 0;
  for (const Image& face : image.faces) count += count_nonfinite(face);
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
  const int channels = levels.front().channels.count(), in_file = levels_in_file(plan, job, outcome.shape.height);
  const std::vector<LevelFile> files =
      level_files(plan.options.levels, level_place(plan, job), std::move(levels), write.type);
  for (const std::string& path : job.paths) {
    ENVCONV_CHECK(can_write(path, write, pictures_of(plan), channels, in_file));
  }
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

Result<Outcome> convert(const ConvertPlan& plan, const Job& job, const std::function<void(double)>& begin,
                        const std::function<bool(double)>& progress) {
  const ConvertOptions& o = plan.options;
  Outcome outcome;
  if (o.skip_existing && is_complete(plan, job)) {
    outcome.skipped = true;
    return outcome;
  }
  ReadOptions read = with_color(o.input.read, plan.color, job.input.paths.front());
  read.threads = o.threads;
  ENVCONV_TRY(PictureFile file, read_input(job.input, read));
  if (file.pictures.empty()) return Error{ErrorCode::input, job.input.name + ": holds no picture"};
  ENVCONV_TRY(outcome.shape, shape_of(plan, job, file));
  outcome.warnings = file.warnings;
  const Recognition& source = outcome.shape.source;
  outcome.warnings.insert(outcome.warnings.end(), source.warnings.begin(), source.warnings.end());
  const PixelType source_type = file.pictures.front().type;

  const SourceColor& color = outcome.shape.color;
  ENVCONV_TRY(EnvImage image, to_environment(std::move(file), source));
  ENVCONV_CHECK(treat_nonfinite(plan, job, image, outcome.warnings));
  ENVCONV_CHECK(named(job, to_working(plan.color, color, image.channels, image.faces)));
  change_values(o, image);
  WriteOptions write = write_options(plan, job, outcome.shape, composed(source.rotation, o.rotation), source_type);
  const float peak = wants_peak(plan.color, source_type, write.type) ? largest_color(image) : 0;
  const OutputColor output = output_color(plan.color, image.channels, write.type, peak);
  if (output.is_preview) {
    outcome.warnings.push_back("values up to " + number_text(static_cast<double>(peak), 6) + " are shown through " +
                               view_text(*output.view) + " (--view none clips them)");
  }

  ResampleOptions resample_options;
  resample_options.layout = o.layout;
  resample_options.height = outcome.shape.height;
  resample_options.placement = placement_for(*o.layout, o.levels.seam);
  resample_options.consumer_from_world = o.frame->consumer_from_world;
  resample_options.rotation = o.rotation;
  resample_options.filter = o.filter;
  resample_options.samples = o.samples;
  resample_options.threads = o.threads;
  resample_options.progress = progress;
  begin(static_cast<double>(texel_count(*o.layout, outcome.shape.height)));
  ENVCONV_TRY(EnvImage result, named(job, resample(image, resample_options)));
  image = {};

  // Levels are means of linear light: colours are encoded after them.
  ENVCONV_TRY(std::vector<EnvImage> levels,
              named(job, make_levels(o.levels, level_place(plan, job), std::move(result), o.threads)));
  if (o.levels.max_seam) outcome.seam = worst_seam(o.levels, levels);
  for (EnvImage& level : levels) ENVCONV_CHECK(named(job, to_output(plan.color, output, color, level, write)));
  outcome.color = write.color.space;
  ENVCONV_CHECK(write_files(plan, job, write, std::move(levels), outcome));
  if (outcome.seam && outcome.seam->error > *o.levels.max_seam) {
    return Error{ErrorCode::threshold,
                 job.output + ": the largest seam error is " + number_text(outcome.seam->error, 4) + ", at level " +
                     std::to_string(outcome.seam->level) + ", above --max-seam " + number_text(*o.levels.max_seam, 9)};
  }
  return outcome;
}

}  // namespace

Result<Outcome> run_job(const ConvertPlan& plan, const Job& job, const std::function<void(double)>& begin,
                        const std::function<bool(double)>& progress) {
  if (job.error) return *job.error;
  try {
    return convert(plan, job, begin, progress);
  } catch (const std::bad_alloc&) {
    return Error{ErrorCode::limit, job.input.name + ": not enough memory (choose a smaller --size)"};
  }
}

}  // namespace envconv::tool
