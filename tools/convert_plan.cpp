// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <iterator>
#include <map>
#include <thread>

#include "analyze.h"
#include "convert.h"
#include "memory.h"
#include "standard_input.h"
#include "text.h"

namespace envconv::tool {
namespace {

namespace fs = std::filesystem;
using FileId = std::pair<dev_t, ino_t>;

Error usage(const std::string& text) { return {ErrorCode::usage, text}; }

// Two spellings of one path give the same text; the file need not exist.
std::string canonical(const std::string& path) {
  std::error_code error;
  const fs::path whole = fs::weakly_canonical(fs::absolute(path, error), error);
  return error ? path : whole.string();
}

// Files that keep faces apart: as --output says, or where it leaves the extension to them, as the inputs are.
bool writes_containers(const ConvertOptions& o, const std::vector<std::string>& inputs) {
  if (!o.output.ends_with('/') && !o.output.ends_with("{ext}")) return holds_faces(o.output);
  return !inputs.empty() && std::ranges::all_of(inputs, holds_faces);
}

Result<Ok> fill_in(ConvertOptions& o, const std::vector<std::string>& inputs) {
  if (!o.layout) o.layout = find_layout("cube");
  if (!o.frame) o.frame = find_frame("world");
  // More than there are cores gain nothing; but that results do not depend on them can be seen on small machines too.
  constexpr int always = 8;
  const int cores = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  o.threads = o.threads == 0 ? cores : std::min(o.threads, std::max(cores, always));
  if (o.memory == 0) o.memory = static_cast<std::int64_t>(available_memory() / 4 * 3);
  if (o.size && o.texels) return usage("--size and --texels: only one of them can be given");
  if (!o.packing) {
    // A name for every face asks for a file for every face.
    const Result<OutputName> name = OutputName::parse(o.output, false);
    const bool per_face = name && (name->uses("face") || name->uses("face_index"));
    const bool apart = writes_containers(o, inputs) && o.layout->face_count() > 1 && faces_are_alike(*o.layout);
    o.packing = per_face ? find_packing("files") : apart ? find_packing("parts") : &default_packing(*o.layout);
  }
  if (!packs(*o.packing, *o.layout)) {
    std::vector<std::string_view> possible;
    for (const Packing& packing : all_packings()) {
      if (packs(packing, *o.layout)) possible.push_back(packing.name);
    }
    return Error{ErrorCode::unsupported, "--packing: '" + std::string(o.packing->name) + "' cannot hold " +
                                             std::string(o.layout->name()) + " (which can be packed as " +
                                             joined(possible) + ")"};
  }
  const bool parts = o.packing->name == "parts";
  if (parts && writes_containers(o, inputs) && !faces_are_alike(*o.layout)) {
    return Error{ErrorCode::unsupported, "--packing: faces of " + std::string(o.layout->name()) +
                                             " differ in size, which layers of one file cannot (choose " +
                                             std::string(default_packing(*o.layout).name) + ")"};
  }
  o.write.cube = parts && is_cube_map(*o.layout);
  return Ok{};
}

Result<OutputName> parse_output(const ConvertOptions& o, std::size_t inputs) {
  if (o.output.empty()) return usage("--output: missing (say where to write with -o PATH)");
  const bool per_face = o.packing->name == "files";
  ENVCONV_TRY(OutputName name, OutputName::parse(o.output, per_face));
  const bool has_face = name.uses("face") || name.uses("face_index");
  if (per_face && !has_face) {
    return usage("--output: '" + o.output + "' has no {face}, which tells the files of --packing files apart");
  }
  if (!per_face && has_face) {
    return usage("--output: {face} is for --packing files, and --packing is " + std::string(o.packing->name));
  }
  if (inputs > 1 && !name.uses("stem") && !name.uses("index") && !name.uses("dir")) {
    return usage("--output: '" + o.output + "' would be written by all of " + std::to_string(inputs) +
                 " inputs (use {stem} or {index} in it, or a folder's name that ends in '/')");
  }
  return name;
}

// The folder below which a template's outputs must lie: what comes before the first field, or with {dir} at its
// beginning the input's own folder.
std::string base_of(const OutputName& name, NameFields fields) {
  const std::string text = name.expand_beginning(fields);
  const std::size_t slash = text.rfind('/');
  return slash == std::string::npos ? "." : slash == 0 ? "/" : text.substr(0, slash);
}

// A name that came with an input must not lead the output elsewhere: "...exr" has the stem "..", and a folder may be a
// link.
Result<Ok> check_below(const std::string& path, const std::string& base) {
  const fs::path folder = fs::path(path).parent_path();
  const std::string text = folder.empty() ? "." : folder.string();
  if (text == base) return Ok{};
  const fs::path inner = canonical(text), outer = canonical(base);
  const auto [end, rest] = std::mismatch(outer.begin(), outer.end(), inner.begin(), inner.end());
  const bool below = end == outer.end() || (std::next(end) == outer.end() && end->empty());
  if (below) return Ok{};
  return usage(path + ": would lie outside of " + base + ", by way of the input's name or of a link (choose another " +
               "--output)");
}

// The job's output names.  {size} may need the input's header, which is read for a job of the shard only: what that
// finds wrong is the job's own error.
Result<Ok> name_outputs(const ConvertPlan& plan, const OutputName& name, bool may_read, Job& job) {
  const ConvertOptions& o = plan.options;
  NameFields fields = fields_of_input(job.input.name);
  fields.layout = o.layout->name();
  fields.index = job.index;
  fields.size = o.size ? o.size : o.texels ? height_for_texels(*o.layout, o.texels) : 0;
  job.file_a_level = name.uses("mip");
  if ((name.uses("size") || job.file_a_level) && fields.size == 0) {
    if (!may_read) return Ok{};
    ENVCONV_TRY(const Shape shape, read_shape(plan, job));
    fields.size = shape.height;
  }
  const std::string base = base_of(name, fields);
  const int levels = job.file_a_level ? levels_to_make(o.levels, level_place(plan, job), fields.size) : 1;
  const int files = o.packing->name == "files" ? o.layout->face_count() : 1;
  for (fields.mip = 0; fields.mip < levels; ++fields.mip) {
    for (int face = 0; face < files; ++face) {
      fields.face = o.layout->info().faces[static_cast<std::size_t>(face)].name;
      fields.face_index = face;
      job.paths.push_back(name.expand(fields));
      ENVCONV_CHECK(check_below(job.paths.back(), base));
    }
  }
  fields.face = "{face}";
  fields.mip = 0;
  job.output = files > 1 && name.uses("face") ? name.expand(fields) : job.paths.front();
  return Ok{};
}

// An existing output must be a plain file that is no input; a new one needs its folder.
Result<Ok> check_place(const std::string& path, const std::map<FileId, std::string>& inputs) {
  struct stat status;
  if (stat(path.c_str(), &status) == 0) {
    const auto input = inputs.find({status.st_dev, status.st_ino});
    if (input != inputs.end()) {
      return usage(path + ": is the input " + input->second + " itself (choose another output)");
    }
    if (S_ISDIR(status.st_mode)) return usage(path + ": is a folder (end its name with '/' to write into it)");
    if (!S_ISREG(status.st_mode)) return usage(path + ": is not a regular file (choose another output)");
  } else if (lstat(path.c_str(), &status) == 0) {
    return usage(path + ": is a symbolic link that leads nowhere (remove it first)");
  }
  const std::string folder = folder_of(path);
  if (stat(folder.c_str(), &status) != 0) {
    return Error{ErrorCode::output,
                 path + ": cannot be written: folder " + folder + ": " + std::strerror(errno) + " (create it first)"};
  }
  if (!S_ISDIR(status.st_mode))
    return Error{ErrorCode::output, path + ": cannot be written: " + folder + " is no folder"};
  if (access(folder.c_str(), W_OK | X_OK) != 0) {
    return Error{ErrorCode::output, path + ": cannot be written: folder " + folder + ": " + std::strerror(errno)};
  }
  return Ok{};
}

// True when the folder's file system takes "A" and "a" for one name: found out with a file of our own.
bool folds_case(const std::string& folder) {
  const std::string lower = folder + "/.envconv-" + std::to_string(getpid()) + "-ca5ef01d0000.tmp";
  const std::string upper = folder + "/.ENVCONV-" + std::to_string(getpid()) + "-CA5EF01D0000.TMP";
  const int fd = open(lower.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (fd < 0) return false;
  close(fd);
  const bool folds = access(upper.c_str(), F_OK) == 0;
  unlink(lower.c_str());
  return folds;
}

// Who writes what.  Names that differ in case only are one name on some file systems.
class Writers {
 public:
  Result<Ok> add(const std::string& path, const std::string& input) {
    const std::string whole = canonical(path);
    std::string folded = whole;
    for (char& c : folded) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    const auto [other, is_new] = names_.emplace(std::move(folded), Writer{whole, input});
    if (is_new) return Ok{};
    if (other->second.path != whole) {
      const std::string folder = fs::path(whole).parent_path();
      const auto known = folds_.find(folder);
      const bool folds = known != folds_.end() ? known->second : (folds_[folder] = folds_case(folder));
      if (!folds) return Ok{};
    }
    return usage(path + ": would be written twice, for " + other->second.input + " and for " + input +
                 " (use {dir}, {index} or {face} in --output to tell them apart)");
  }

 private:
  struct Writer {
    std::string path, input;
  };
  std::map<std::string, Writer> names_;  // by name in lower case
  std::map<std::string, bool> folds_;    // by folder
};

// Of all jobs, those of other shards too, so that every shard of a batch finds the same; but where outputs are to be
// written is the shard's own business.
Result<Ok> check_outputs(const ConvertPlan& plan, const std::vector<Job>& others) {
  std::map<FileId, std::string> inputs;
  for (const auto* jobs : {&plan.jobs, &others}) {
    for (const Job& job : *jobs) {
      for (const std::string& path : job.input.paths) {
        struct stat status;
        if (stat(path.c_str(), &status) == 0)
          inputs[{status.st_dev, status.st_ino}] = job.input.layout ? path : job.input.name;
      }
    }
  }
  Writers writers;
  const ConvertOptions& o = plan.options;
  // Of sizes that are not known yet it is only certain that there are levels.
  const int unknown = 2;
  for (const Job& job : plan.jobs) {
    if (job.error) continue;
    for (const std::string& path : job.paths) {
      ENVCONV_CHECK(writers.add(path, job.input.name));
      ENVCONV_CHECK(check_place(path, inputs));
      ENVCONV_CHECK(
          can_write(path, o.write, pictures_of(plan), 3, levels_in_file(plan, job, o.size ? o.size : unknown)));
    }
  }
  for (const Job& job : others) {
    for (const std::string& path : job.paths) ENVCONV_CHECK(writers.add(path, job.input.name));
  }
  return Ok{};
}

}  // namespace

std::string folder_of(const std::string& path) {
  const fs::path parent = fs::path(path).parent_path();
  return parent.empty() ? "." : parent.string();
}

LevelPlace level_place(const ConvertPlan& plan, const Job& job) {
  const std::string& path = job.paths.empty() ? plan.options.output : job.paths.front();
  return {plan.options.layout, plan.options.packing, path, job.file_a_level};
}

int pictures_of(const ConvertPlan& plan) {
  return plan.options.packing->name == "parts" ? plan.options.layout->face_count() : 1;
}

int levels_in_file(const ConvertPlan& plan, const Job& job, int height) {
  return job.file_a_level ? 1 : levels_to_make(plan.options.levels, level_place(plan, job), height);
}

Result<std::vector<std::string>> all_inputs(const ConvertOptions& o, std::vector<std::string> named) {
  if (o.files_from.empty()) {
    if (o.null_separated) return usage("--null: is for the names of --files-from");
    if (named.empty()) return usage("convert: INPUT... is missing (see 'envconv convert --help')");
    return named;
  }
  if (o.files_from == "-" && std::ranges::find(named, standard_input) != named.end())
    return usage("--files-from: standard input cannot be a list of names and a picture");
  const std::string shown = o.files_from == "-" ? "standard input" : o.files_from;
  const int fd = o.files_from == "-" ? STDIN_FILENO : open(o.files_from.c_str(), O_RDONLY | O_CLOEXEC);
  std::string text;
  ssize_t n = fd < 0 ? -1 : 1;
  while (n > 0 || (n < 0 && fd >= 0 && errno == EINTR)) {
    char piece[65536];
    n = read(fd, piece, sizeof piece);
    if (n > 0) text.append(piece, static_cast<std::size_t>(n));
  }
  const int code = errno;
  if (fd > STDIN_FILENO) close(fd);
  if (n < 0) return Error{ErrorCode::input, shown + ": cannot be read: " + std::strerror(code)};
  // Names are taken as they are: no comments, no quotes, and spaces belong to them.
  const char end = o.null_separated ? '\0' : '\n';
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t stop = std::min(text.find(end, at), text.size());
    if (stop > at) named.push_back(text.substr(at, stop - at));
    at = stop + 1;
  }
  if (!o.null_separated && text.find('\0') != std::string::npos) {
    return usage("--files-from: " + shown + " holds zero bytes (-0 reads names that end with them)");
  }
  return named;
}

Result<ConvertPlan> make_plan(ConvertOptions options, const std::vector<std::string>& inputs) {
  ENVCONV_CHECK(fill_in(options, inputs));
  ENVCONV_TRY(const OutputName name, parse_output(options, inputs.size()));
  const bool is_batch = inputs.size() != 1 || !options.files_from.empty() || options.shards > 1;
  ConvertPlan plan{std::move(options), {}, {}, is_batch};
  std::vector<std::string> first_files;
  for (const std::string& name : inputs) {
    first_files.push_back(input_named(name, plan.options.input.hints).paths.front());
  }
  ENVCONV_TRY(plan.color, plan_color(plan.options.color, first_files));
  std::vector<Job> others;
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    Job job;
    job.input = input_named(inputs[i], plan.options.input.hints);
    job.index = static_cast<int>(i);
    const bool ours = job.index % plan.options.shards == plan.options.shard - 1;
    Result<Ok> good = ours ? check_readable(job.input) : Ok{};
    if (good) good = name_outputs(plan, name, ours, job);
    if (!good) {
      const bool tolerable = good.error().code == ErrorCode::input || good.error().code == ErrorCode::limit;
      if (!plan.options.keep_going || inputs.size() == 1 || !tolerable) return good.error();
      job.error = good.error();
    }
    (ours ? plan.jobs : others).push_back(std::move(job));
  }
  ENVCONV_CHECK(check_outputs(plan, others));
  return plan;
}

Result<ConvertPlan> plan_output(ConvertOptions options, const std::string& name) {
  ENVCONV_CHECK(fill_in(options, {}));
  ENVCONV_TRY(const OutputName output, parse_output(options, 1));
  ConvertPlan plan;
  plan.options = std::move(options);
  Job job;
  job.input.name = name;
  ENVCONV_CHECK(name_outputs(plan, output, false, job));
  plan.jobs.push_back(std::move(job));
  ENVCONV_CHECK(check_outputs(plan, {}));
  return plan;
}

Result<Shape> shape_of(const ConvertPlan& plan, const Job& job, const PictureFile& file) {
  const ConvertOptions& o = plan.options;
  Shape shape;
  ENVCONV_TRY(shape.source, recognize_input(job.input, file, o.input.hints));
  std::size_t source_values = 0;
  for (const Picture& picture : file.pictures) source_values += picture.image.value_count();
  shape.image = {file.pictures.front().image.width(), file.pictures.front().image.height()};
  shape.channels = file.pictures.front().channels.count();
  ENVCONV_TRY(shape.color, source_color(plan.color, file, job.input.paths.front()));
  shape.height = o.size     ? o.size
                 : o.texels ? height_for_texels(*o.layout, o.texels)
                            : matching_height(*shape.source.layout, shape.source.height, *o.layout);
  // Whole blocks, which Direct3D wants.
  const bool chosen = o.size == 0 && o.texels == 0;
  if (chosen && o.write.type_given && o.write.type == PixelType::bc6h) shape.height = (shape.height + 3) / 4 * 4;
  std::size_t texels = 0;
  for (int face = 0; face < o.layout->face_count(); ++face) {
    const Size size = face_size(*o.layout, face, shape.height);
    // Twice, since a lat-long is twice as wide as it is high.
    if (shape.height > largest_size || size.width > 4 * largest_size) {
      return Error{ErrorCode::limit, job.input.name + ": the output's faces would be " + std::to_string(size.width) +
                                         "x" + std::to_string(size.height) + " (choose a smaller one with --size)"};
    }
    shape.faces.push_back(size);
    texels += static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
  }
  const LevelPlace place = level_place(plan, job);
  shape.levels = levels_to_make(o.levels, place, shape.height);
  ENVCONV_CHECK(check_levels(o.levels, place, shape.height));
  const int in_file = levels_in_file(plan, job, shape.height);
  for (const std::string& path : job.paths) {
    ENVCONV_CHECK(can_write(path, o.write, pictures_of(plan), shape.channels, in_file));
  }
  shape.source_bytes = sizeof(float) * source_values;
  shape.result_bytes = sizeof(float) * texels * static_cast<std::size_t>(shape.channels);
  shape.memory = plan_memory(plan, job, shape, file);
  return shape;
}

Result<Shape> read_shape(const ConvertPlan& plan, const Job& job) {
  ReadOptions read = with_color(plan.options.input.read, plan.color, job.input.paths.front());
  read.header_only = true;
  ENVCONV_TRY(const PictureFile file, read_input(job.input, read));
  if (file.pictures.empty()) return Error{ErrorCode::input, job.input.name + ": holds no picture"};
  return shape_of(plan, job, file);
}

}  // namespace envconv::tool
