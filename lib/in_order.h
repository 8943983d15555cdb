// SPDX-License-Identifier: Apache-2.0
// Chunks of a file that are packed on all threads and stored in their order.  Internal: not installed.
#pragma once

#include <tbb/parallel_pipeline.h>
#include <tbb/task_arena.h>

#include <cstdint>
#include <vector>

namespace envconv {

/// Calls make(packer, i) for i = 0 to count - 1, on the threads of the arena that this is called in, and
/// store(packer, i) in the order of i, one at a time.  A Packer is default-constructed, holds what has been made until
/// it is stored, and is used again, by whatever thread: its buffers are kept.
template <class Packer, class Make, class Store>
void in_order(std::int64_t count, Make&& make, Store&& store) {
  if (count == 1) {
    Packer packer;
    make(packer, std::int64_t{0});
    return store(packer, std::int64_t{0});
  }
  // Chunks leave in their order, so no two that are under way at a time have the same packer.
  std::vector<Packer> packers(static_cast<std::size_t>(tbb::this_task_arena::max_concurrency()) + 1);
  const auto packer_of = [&](std::int64_t i) -> Packer& {
    return packers[static_cast<std::size_t>(i) % packers.size()];
  };
  std::int64_t next = 0;
  const auto take =
      tbb::make_filter<void, std::int64_t>(tbb::filter_mode::serial_in_order, [&](tbb::flow_control& flow) {
        if (next == count) flow.stop();
        return next++;
      });
  const auto pack = tbb::make_filter<std::int64_t, std::int64_t>(tbb::filter_mode::parallel, [&](std::int64_t i) {
    make(packer_of(i), i);
    return i;
  });
  const auto put = tbb::make_filter<std::int64_t, void>(tbb::filter_mode::serial_in_order,
                                                        [&](std::int64_t i) { store(packer_of(i), i); });
  tbb::parallel_pipeline(packers.size(), take & pack & put);
}

}  // namespace envconv
