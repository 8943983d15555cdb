// SPDX-License-Identifier: Apache-2.0
// Independent parts of a file that are decoded by several threads.  Internal: not installed.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <limits>
#include <mutex>
#include <new>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "result.h"

namespace envconv {

/// What the threads of decode_blocks() share.
class BlockQueue {
 public:
  BlockQueue(std::int64_t first, std::int64_t end) : next_(first), end_(end) {}

  std::optional<std::int64_t> take() {
    const std::int64_t number = next_++;
    return number < end_ ? std::optional(number) : std::nullopt;
  }
  /// Nothing more is taken.  Of several errors the one of the first block is told: those before it were taken earlier.
  void fail(std::int64_t number, Error error) {
    const std::lock_guard lock(mutex_);
    next_ = end_;
    if (number >= failed_) return;
    failed_ = number;
    error_ = std::move(error);
  }
  Result<Ok> result() const { return error_ ? Result<Ok>(*error_) : Result<Ok>(Ok{}); }

 private:
  std::atomic<std::int64_t> next_;
  std::int64_t end_;
  std::mutex mutex_;
  std::int64_t failed_ = std::numeric_limits<std::int64_t>::max();
  std::optional<Error> error_;
};

/// Calls read(thread, i) once for each block i from `first` to `end` - 1, with threads numbered from 0, of which there
/// are `threads` at most, and no two calls with the same number at a time.  Error: the first block's that has one, the
/// same whatever the number of threads; limit, where memory ran out.  The threads are its own: in a process that was
/// forked, those of a library are not there.
template <class Read>
Result<Ok> decode_blocks(std::int64_t first, std::int64_t end, int threads, Read&& read) {
  BlockQueue queue(first, end);
  const auto work = [&](int thread) {
    std::int64_t number = first;
    try {
      while (const auto taken = queue.take()) {
        number = *taken;
        const Result<Ok> done = read(thread, number);
        if (!done) queue.fail(number, done.error());
      }
    } catch (const std::bad_alloc&) {
      queue.fail(number, {ErrorCode::limit, "not enough memory to decode it"});
    }
  };
  std::vector<std::jthread> others;
  try {
    const auto wanted = static_cast<int>(std::min<std::int64_t>(threads, end - first));
    for (int i = 1; i < wanted; ++i) others.emplace_back(work, i);
  } catch (const std::system_error&) {
    // Fewer do as well.
  }
  work(0);
  others.clear();
  return queue.result();
}

}  // namespace envconv
