// SPDX-License-Identifier: Apache-2.0
// A file that takes its name only when it is whole.  Internal: not installed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "result.h"

namespace envconv {

/// Removes the temporary files that this process has open, and makes no more.  Async-signal-safe: a handler of SIGINT
/// and the like may call it before the process dies.
void remove_temporaries() noexcept;

/// Removes from a folder the temporaries of processes that were killed: those whose process is gone and that nobody has
/// locked.  Once a folder and process; writing into a folder does it too.
void remove_stale_temporaries(const std::string& folder);

/// A new file in a folder, open for reading and writing, that has no name: it is gone with its last descriptor and
/// mapping.  -1 and errno when there is none to be had.
int open_nameless(const std::string& folder);

/// A path as it may be shown to a person: control bytes become \xNN.
std::string printable(const std::string& text);

/// Writes to `.envconv-<pid>-<random>.tmp` in the folder of the output and renames it when told that all is well.
///
/// Writing never fails as far as the caller can see: the first error is remembered and every later byte is dropped.  A
/// codec must not meet an error half way: some hang, some exit, most return success.
class OutputFile {
 public:
  /// Errors: ErrorCode::output for a folder that does not exist, an output that is a directory, FIFO or device, a
  /// dangling symbolic link.  A link to a file is followed: its target is what gets replaced.
  static Result<OutputFile> create(const std::string& path);

  OutputFile(OutputFile&&) noexcept;
  OutputFile& operator=(OutputFile&&) = delete;
  ~OutputFile();  ///< removes the temporary unless commit() succeeded

  void write(const void* data, std::size_t size);  ///< at the position, which moves on
  std::size_t read(void* data, std::size_t size);  ///< likewise; how many bytes there were
  void seek(std::uint64_t position);
  std::uint64_t tell() const;
  std::uint64_t size() const;
  const std::string& temporary() const;  ///< the temporary's path

  /// All is on the disk, or the first error that occurred.
  Result<Ok> sync();
  /// sync(), then the rename, then the folder's own sync.
  Result<Ok> commit();

 private:
  struct State;
  explicit OutputFile(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace envconv
