// SPDX-License-Identifier: Apache-2.0
// The tool's main(): finds the verb, parses, runs, and turns errors into exit statuses.
#include <fcntl.h>
#include <hwy/nanobenchmark.h>
#include <hwy/targets.h>
#include <unistd.h>

#include <cstdint>
#include <exception>
#include <new>
#include <string_view>

#include "command.h"
#include "generate.h"
#include "interrupt.h"
#include "io.h"
#include "text.h"

// Highway's library measures the clock's resolution whenever it is loaded, for its own benchmarks: 4.3 ms of processor
// time, more than the rest of `--version`.  A program's definition comes before a library's.
__attribute__((weak)) std::uint64_t hwy::platform::TimerResolution() { return 1; }

namespace envconv::tool {
namespace {

// A file opened later must not get the number of a standard stream that the caller closed.
void hold_standard_streams() {
  for (int fd = 0; fd <= 2; ++fd) {
    if (fcntl(fd, F_GETFD) != -1) continue;
    // The other way round, so that what uses a closed stream is still an error.
    if (open("/dev/null", fd == STDIN_FILENO ? O_WRONLY : O_RDONLY) < 0) return;
  }
}

std::string simd_target() {
  // The lowest bit is the best target.
  const auto usable = static_cast<long long>(hwy::SupportedTargets()) & HWY_TARGETS;
  const long long best = usable & -usable;
  return best ? hwy::TargetName(static_cast<decltype(hwy::SupportedTargets())>(best)) : "scalar";
}

std::string version_text() {
  return std::string("envconv ") + ENVCONV_VERSION + "\nOpenEXR " + ENVCONV_OPENEXR_VERSION + "\nOpenImageIO " +
         ENVCONV_OIIO_VERSION + " (loaded for formats other than OpenEXR and Radiance)\nOpenColorIO " +
         ENVCONV_OCIO_VERSION + "\nSIMD " + simd_target() + "\nLicence Apache-2.0\n";
}

int unknown_verb(const std::string& word) {
  std::vector<std::string_view> names{"--help", "--version"};
  for (const Command& command : all_commands()) names.push_back(command.name);
  const std::string kind = word.starts_with('-') ? "option" : "verb";
  complain(word + ": no such " + kind + did_you_mean(word, names) + " (see 'envconv --help')");
  return static_cast<int>(ErrorCode::usage);
}

int run(std::vector<std::string> words) {
  if (words.empty()) {
    complain("a verb is missing (see 'envconv --help')");
    return static_cast<int>(ErrorCode::usage);
  }
  const std::string verb = words.front();
  words.erase(words.begin());
  if (verb == "--help" || verb == "-h" || (verb == "help" && words.empty())) {
    print(general_help());
    return 0;
  }
  if (verb == "--version") {
    print(version_text());
    return 0;
  }
  if (verb == "help") return run({words.front(), "--help"});
  if (verb == "--generate" && words.size() == 2) {
    const Result<std::string> text = generate(words[0], words[1]);
    if (!text) return fail(text.error());
    print(*text);
    return 0;
  }
  const Command* command = find_command(verb);
  if (!command) return unknown_verb(verb);
  const Result<Invocation> invocation = parse(*command, words);
  if (!invocation) return fail(invocation.error());
  if (invocation->help) {
    print(command_help(*command));
    return 0;
  }
  return command->run(invocation->operands);
}

// A line on stderr that takes no memory.
void last_words(std::string_view line) {
  [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, line.data(), line.size());
}

int out_of_memory() {
  last_words("envconv: not enough memory\n");
  return static_cast<int>(ErrorCode::limit);
}

// True in a thread once it was refused memory.
thread_local bool was_refused_memory = false;

// What operator new calls when there is none.
void note_refusal() {
  was_refused_memory = true;
  throw std::bad_alloc();
}

// An exception that must not leave its place: in a noexcept function of a library, or in a
// library's own thread, that runs out of memory.  Where it passes a noexcept function that has something to clean up,
// GCC ends the program before anybody has caught it, so that it cannot be asked for.
[[noreturn]] void on_terminate() {
  remove_unfinished();
  int status = static_cast<int>(ErrorCode::internal);
  try {
    if (std::current_exception()) throw;
    if (was_refused_memory && std::uncaught_exceptions() > 0) status = out_of_memory();
  } catch (const std::bad_alloc&) {
    status = out_of_memory();
  } catch (...) {
  }
  if (status == static_cast<int>(ErrorCode::internal)) last_words("envconv: a bug in envconv\n");
  _exit(status);
}

}  // namespace
}  // namespace envconv::tool

int main(int argc, char** argv) {
  using namespace envconv::tool;
  hold_standard_streams();
  std::set_terminate(on_terminate);
  std::set_new_handler(note_refusal);
  std::vector<std::string> words(argv + (argc > 0 ? 1 : 0), argv + argc);
  try {
    const Command* command = words.empty() ? nullptr : find_command(words.front());
    // Before any thread is made.
    if (command && command->reads_files) envconv::start_isolated_reader();
    watch_signals();
    return finish_output(run(std::move(words)));
  } catch (const std::bad_alloc&) {
    return out_of_memory();
  } catch (const std::exception& error) {
    complain(std::string("a bug in envconv: ") + error.what());
  } catch (...) {
    complain("a bug in envconv");
  }
  return static_cast<int>(envconv::ErrorCode::internal);
}
