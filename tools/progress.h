// SPDX-License-Identifier: Apache-2.0
// A progress bar on stderr.
#pragma once

#include <chrono>

namespace envconv::tool {

/// One bar for a whole batch, drawn by one thread.
class Progress {
 public:
  /// How far a batch is.
  struct Count {
    int converted = 0, failed = 0, skipped = 0;  ///< files that have ended
    double running = 0;                          ///< shares, 0 to 1 each, of those in work, added up
    double texels = 0;                           ///< of outputs, done
  };

  /// A bar that shows nothing unless `shown`; `total` files.
  Progress(bool shown, int total);
  ~Progress();
  /// Draws the bar, unless it was drawn a moment ago.
  void update(const Count& count);
  /// Takes the bar away, so that a message can be printed; the next update brings it back.
  void hide();

 private:
  using Clock = std::chrono::steady_clock;
  void draw(const Count& count, Clock::time_point now);

  const bool shown_;
  const int total_;
  bool drawn_ = false;
  const Clock::time_point started_;
  Clock::time_point next_;
};

}  // namespace envconv::tool
