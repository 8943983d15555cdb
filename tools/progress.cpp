// SPDX-License-Identifier: Apache-2.0
#include "progress.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "text.h"

namespace envconv::tool {
namespace {

constexpr auto interval = std::chrono::milliseconds(100);
constexpr int bar_width = 24;

void put(const std::string& text) {
  if (write(STDERR_FILENO, text.data(), text.size()) < 0) return;  // a bar that cannot be drawn is not missed
}

// "4:05", "1:02:03"
std::string time_text(double seconds) {
  const long all = std::lround(seconds), minutes = all / 60 % 60;
  const auto two = [](long n) { return (n < 10 ? "0" : "") + std::to_string(n); };
  if (all >= 3600) return std::to_string(all / 3600) + ":" + two(minutes) + ":" + two(all % 60);
  return std::to_string(minutes) + ":" + two(all % 60);
}

}  // namespace

Progress::Progress(bool shown, int total) : shown_(shown), total_(total), started_(Clock::now()), next_(started_) {}
Progress::~Progress() { hide(); }

void Progress::update(const Count& count) {
  const Clock::time_point now = Clock::now();
  if (!shown_ || total_ == 0 || now < next_) return;
  next_ = now + interval;
  draw(count, now);
}

void Progress::draw(const Count& count, Clock::time_point now) {
  const int ended = count.converted + count.failed + count.skipped;
  const double share = std::clamp((ended + count.running) / total_, 0.0, 1.0);
  const double elapsed = std::chrono::duration<double>(now - started_).count();
  std::string bar(static_cast<std::size_t>(share * bar_width), '#');
  bar.resize(bar_width, '.');
  std::string line = "\r[" + bar + "] " + std::to_string(static_cast<int>(100 * share)) + "%";
  if (total_ > 1) line += " " + std::to_string(count.converted) + " of " + std::to_string(total_);
  if (count.failed > 0) line += ", " + std::to_string(count.failed) + " failed";
  if (count.skipped > 0) line += ", " + std::to_string(count.skipped) + " skipped";
  if (count.texels > 0 && elapsed > 0) line += ", " + number_text(1e-6 * count.texels / elapsed, 3) + " Mtexel/s";
  // What was skipped took no time to speak of, so it tells nothing of the rest.
  const double work = share - static_cast<double>(count.skipped) / total_;
  if (work > 0.01 && elapsed > 1) line += ", " + time_text(elapsed * (1 - share) / work) + " left";
  put(line + "\x1b[K");
  drawn_ = true;
}

void Progress::hide() {
  if (!drawn_) return;
  put("\r\x1b[K");
  drawn_ = false;
  next_ = {};
}

}  // namespace envconv::tool
