// SPDX-License-Identifier: Apache-2.0
// Runs a plan and reports on it: a line on stderr for what went wrong, one JSON object a job, in the jobs' order.
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "convert.h"
#include "interrupt.h"
#include "memory.h"
#include "output_file.h"
#include "progress.h"
#include "text.h"

namespace envconv::tool {
namespace {

using nlohmann::ordered_json;

// A disk that was full so many times running is taken to stay full.
constexpr int most_full_disks = 3;

// What is known of a job, done or planned.
ordered_json json_of(const ConvertPlan& plan, const Job& job, const Shape* shape) {
  ordered_json json{{"input", job.input.name}, {"output", job.output}, {"files", job.paths}};
  json["layout"] = plan.options.layout->name();
  json["packing"] = plan.options.packing->name;
  json["frame"] = plan.options.frame->name;
  if (!shape || !shape->source.layout) return json;
  json["size"] = shape->height;
  ordered_json faces = ordered_json::array();
  for (std::size_t i = 0; i < shape->faces.size(); ++i) {
    faces.push_back({{"name", plan.options.layout->info().faces[i].name},
                     {"width", shape->faces[i].width},
                     {"height", shape->faces[i].height}});
  }
  json["faces"] = faces;
  json["levels"] = shape->levels;
  json["seam"] = text_of(plan.options.levels.seam);
  json["source"] = {{"layout", shape->source.layout->name()},
                    {"packing", shape->source.packing->name},
                    {"frame", shape->source.frame->name},
                    {"size", shape->source.height},
                    {"width", shape->image.width},
                    {"height", shape->image.height},
                    {"channels", shape->channels},
                    {"colorspace", shape->color.text},
                    {"how", shape->source.how}};
  return json;
}

void print_json(const ordered_json& json) {
  print(json.dump(-1, ' ', false, ordered_json::error_handler_t::replace) + "\n");
}

std::string sentence(const ConvertPlan& plan, const Job& job, const Shape& shape) {
  return job.input.name + ": " + std::string(shape.source.layout->name()) + " " + std::to_string(shape.image.width) +
         "x" + std::to_string(shape.image.height) + ", " + shape.source.how + ", " + shape.color.text + ", to " +
         std::string(plan.options.layout->name()) + ", " + std::to_string(shape.faces.size()) +
         (shape.faces.size() == 1 ? " face" : " faces") + " of " + std::to_string(shape.faces.front().width) + "x" +
         std::to_string(shape.faces.front().height) +
         (shape.levels > 1 ? ", " + std::to_string(shape.levels) + " levels" : "") + ", as " +
         std::string(plan.options.packing->name) + ": " + job.output;
}

std::string scratch_text(const MemoryPlan& memory) {
  return memory.scratch == 0 ? "" : ", and " + megabytes(memory.scratch) + " of scratch storage in " + memory.folder;
}

int print_plan(const ConvertPlan& plan) {
  int failed = 0, status = 0;
  for (const Job& job : plan.jobs) {
    Result<Shape> shape = job.error ? Result<Shape>(*job.error) : read_shape(plan, job);
    Result<Ok> fits = shape ? check_memory(plan, job, *shape) : Ok{};
    const Error* error = !shape ? &shape.error() : !fits ? &fits.error() : nullptr;
    if (error) {
      status = fail(*error);
      ++failed;
    }
    if (plan.options.json) {
      ordered_json json = json_of(plan, job, shape ? &*shape : nullptr);
      json["dry_run"] = true;
      if (shape) json["peak_memory"] = shape->memory.peak;
      if (shape) json["scratch"] = shape->memory.scratch;
      json["error"] = error ? ordered_json(error->message) : ordered_json();
      print_json(json);
    } else if (shape) {
      print(visible(sentence(plan, job, *shape)) + "; at most " + megabytes(shape->memory.peak) + " of memory" +
            scratch_text(shape->memory) + "\n");
    }
    if (failed && !plan.options.keep_going) break;
  }
  return failed && plan.options.keep_going && plan.is_batch ? 7 : status;
}

// What became of a job; written by its thread, read when it has ended.
struct Ended {
  Result<Outcome> outcome = cancelled;
  bool out_of_memory = false;
  double seconds = 0;
  std::size_t peak_memory = 0;
};

bool is_cancelled(const Result<Outcome>& outcome) { return !outcome && outcome.error().message.empty(); }

class Run {
 public:
  explicit Run(const ConvertPlan& plan)
      : plan_(plan),
        o_(plan.options),
        ended_(plan.jobs.size()),
        batch_(static_cast<int>(plan.jobs.size()), o_.threads, static_cast<std::size_t>(o_.memory), o_.keep_going),
        progress_(o_.progress == "always" || (o_.progress == "auto" && verbosity() >= 0 && isatty(STDERR_FILENO)),
                  static_cast<int>(plan.jobs.size())) {}

  int run() {
    const WindingUp winding_up;
    // Now, since a batch of which all is there already writes nothing.
    for (const Job& job : plan_.jobs) {
      for (const std::string& path : job.paths) remove_stale_temporaries(folder_of(path));
    }
    const bool ran = batch_.run({[this](Batch::Turn& turn) { return work(turn); },
                                 [this](int number) { return report(number); }, [this] { tick(); }});
    if (!ran) return fail({ErrorCode::limit, "no thread could be started (raise the limit on memory or processes)"});
    progress_.hide();
    if (o_.json && plan_.is_batch) print_summary(0);
    const int total = static_cast<int>(plan_.jobs.size());
    if (plan_.is_batch && ((failed_ > 0 && verbosity() >= 0 && o_.keep_going) || verbosity() > 0)) {
      complain(std::to_string(total) + (total == 1 ? " input: " : " inputs: ") + std::to_string(converted_) +
               " converted, " + std::to_string(skipped_) + " skipped, " + std::to_string(failed_) + " failed");
    }
    return failed_ > 0 && o_.keep_going && plan_.is_batch ? 7 : status_;
  }

 private:
  bool work(Batch::Turn& turn) {
    const auto number = static_cast<std::size_t>(turn.number());
    Ended& ended = ended_[number];
    meter_.begin(turn.number());
    const auto start = std::chrono::steady_clock::now();
    try {
      ended.outcome = run_job(plan_, plan_.jobs[number], turn);
    } catch (const std::bad_alloc&) {
      ended.out_of_memory = true;
    } catch (const std::exception& error) {
      ended.outcome = Error{ErrorCode::internal, plan_.jobs[number].input.name + ": a bug in envconv: " + error.what()};
    }
    ended.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    ended.peak_memory = meter_.end(turn.number());
    return ended.outcome.ok();
  }

  // What work() had no memory to say.
  void complete(Ended& ended, const Job& job) const {
    if (ended.out_of_memory) ended.outcome = Error{ErrorCode::limit, job.input.name + ": not enough memory"};
  }

  bool report(int number) {
    const Job& job = plan_.jobs[static_cast<std::size_t>(number)];
    Ended& ended = ended_[static_cast<std::size_t>(number)];
    complete(ended, job);
    if (is_cancelled(ended.outcome)) return true;
    progress_.hide();
    count(ended);
    if (o_.json) print_json(json_of_ended(job, ended));
    if (!ended.outcome) {
      status_ = fail(ended.outcome.error());
      failures_.push_back(job.input.name);
      const bool full = ended.outcome.error().system == ENOSPC || ended.outcome.error().system == EDQUOT;
      full_disks_ = full ? full_disks_ + 1 : 0;
      if (full_disks_ >= most_full_disks && o_.keep_going) {
        complain("the disk is full: no further file is begun");
        return false;
      }
      return true;
    }
    full_disks_ = 0;
    for (const std::string& warning : ended.outcome->warnings) warn(job.input.name, warning);
    if (ended.outcome->skipped) {
      remark(job.input.name + ": skipped, since " + job.output + " exists");
    } else {
      remark(sentence(plan_, job, ended.outcome->shape) + ", " + std::string(name_of(ended.outcome->type)) + ", " +
             number_text(ended.seconds, 3) + " s");
    }
    ended.outcome->warnings = {};
    return true;
  }

  void count(const Ended& ended) {
    int& counter = !ended.outcome ? failed_ : ended.outcome->skipped ? skipped_ : converted_;
    ++counter;
  }

  ordered_json json_of_ended(const Job& job, const Ended& ended) const {
    const Result<Outcome>& outcome = ended.outcome;
    ordered_json json = json_of(plan_, job, outcome ? &outcome->shape : nullptr);
    json["index"] = job.index;
    if (outcome && outcome->skipped) json["skipped"] = true;
    if (outcome && !outcome->skipped) {
      json["type"] = name_of(outcome->type);
      json["colorspace"] = outcome->color.empty() ? ordered_json() : ordered_json(outcome->color);
      if (outcome->seam) json["seam_error"] = {{"largest", outcome->seam->error}, {"level", outcome->seam->level}};
    }
    json["seconds"] = ended.seconds;
    if (outcome && !outcome->skipped) {
      json["stages"] = {
          {"read", outcome->read_seconds}, {"resample", outcome->resample_seconds}, {"write", outcome->write_seconds}};
    }
    json["peak_memory"] = ended.peak_memory;
    json["warnings"] = outcome ? outcome->warnings : std::vector<std::string>{};
    json["error"] = outcome ? ordered_json() : ordered_json(outcome.error().message);
    if (!outcome) json["status"] = static_cast<int>(outcome.error().code);
    return json;
  }

  void print_summary(int signal_number) {
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
    const double texels = batch_.texels_done();
    const int total = static_cast<int>(plan_.jobs.size());
    ordered_json json{{"files", total},
                      {"converted", converted_},
                      {"skipped", skipped_},
                      {"failed", failed_},
                      {"not_done", total - converted_ - skipped_ - failed_},
                      {"failures", failures_},
                      {"seconds", seconds},
                      {"texels", static_cast<std::int64_t>(texels)},
                      {"texels_per_second", seconds > 0 ? texels / seconds : 0.0},
                      {"peak_memory", resident_peak()},
                      {"signal", ordered_json()}};
    if (signal_number != 0) json["signal"] = "SIG" + std::string(sigabbrev_np(signal_number));
    print_json({{"summary", std::move(json)}});
  }

  void tick() {
    if (const int signal_number = noted_signal()) stop(signal_number);
    meter_.sample();
    progress_.update({converted_, failed_, skipped_, batch_.running_share(), batch_.texels_done()});
  }

  // The unfinished outputs go at once, with their threads; then what was done is said.
  [[noreturn]] void stop(int signal_number) {
    progress_.hide();
    remove_unfinished();
    for (const int number : batch_.ended_unreported()) report(number);
    if (o_.json && plan_.is_batch) print_summary(signal_number);
    complain("interrupted: " + std::to_string(converted_ + skipped_) + " of " + std::to_string(plan_.jobs.size()) +
             " done");
    die_of(signal_number);
  }

  const ConvertPlan& plan_;
  const ConvertOptions& o_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::vector<Ended> ended_;
  MemoryMeter meter_;
  Batch batch_;
  Progress progress_;
  int converted_ = 0, skipped_ = 0, failed_ = 0, status_ = 0, full_disks_ = 0;
  std::vector<std::string> failures_;
};

}  // namespace

int run_plan(const ConvertPlan& plan) {
  if (plan.options.dry_run) return print_plan(plan);
  Run run(plan);
  return run.run();
}

}  // namespace envconv::tool
