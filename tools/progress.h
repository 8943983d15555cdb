// SPDX-License-Identifier: Apache-2.0
// A progress bar on stderr.
#pragma once

#include <atomic>
#include <chrono>
#include <mutex>
#include <string>

namespace envconv::tool {

/// One bar for a whole batch.  update() may be called from any thread.
class Progress {
 public:
  /// A bar that shows nothing unless `shown`; `total` files.
  Progress(bool shown, int total);
  ~Progress();
  /// Begins the file of that number (from 0), whose output has so many texels.
  void begin(const std::string& name, int number, double texels);
  /// Share of the current file that is done, 0 to 1.
  void update(double share);
  /// Takes the bar away, so that a message can be printed; the next update brings it back.
  void hide();

 private:
  using Clock = std::chrono::steady_clock;
  void draw(double share);

  const bool shown_;
  const int total_;
  std::mutex mutex_;
  std::string name_;
  int number_ = 0;
  double texels_ = 0;
  bool drawn_ = false;
  Clock::time_point started_, file_started_;
  std::atomic<Clock::rep> next_draw_{0};
};

}  // namespace envconv::tool
