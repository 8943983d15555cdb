// SPDX-License-Identifier: Apache-2.0
#include "progress.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace envconv::tool {
namespace {

constexpr auto interval = std::chrono::milliseconds(100);
constexpr int bar_width = 24;

double seconds(std::chrono::steady_clock::duration d) { return std::chrono::duration<double>(d).count(); }

void put(const std::string& text) {
  if (write(STDERR_FILENO, text.data(), text.size()) < 0) return;  // a bar that cannot be drawn is not missed
}

}  // namespace

Progress::Progress(bool shown, int total) : shown_(shown), total_(total), started_(Clock::now()) {}
Progress::~Progress() { hide(); }

void Progress::begin(const std::string& name, int number, double texels) {
  const std::lock_guard lock(mutex_);
  name_ = name.substr(name.rfind('/') + 1).substr(0, 24);
  // Control characters in a file's name would move the cursor.
  for (char& c : name_) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  }
  number_ = number;
  texels_ = texels;
  file_started_ = Clock::now();
}

void Progress::update(double share) {
  if (!shown_) return;
  const Clock::time_point now = Clock::now();
  if (now.time_since_epoch().count() < next_draw_.load(std::memory_order_relaxed)) return;
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock.owns_lock()) return;  // another thread draws
  next_draw_.store((now + interval).time_since_epoch().count(), std::memory_order_relaxed);
  draw(std::clamp(share, 0.0, 1.0));
}

void Progress::draw(double share) {
  const double done = (number_ + share) / total_;
  const double elapsed = seconds(Clock::now() - started_);
  const int full = static_cast<int>(done * bar_width);
  std::string bar(static_cast<std::size_t>(full), '#');
  bar.resize(bar_width, '.');

  char text[160];
  std::snprintf(text, sizeof text, "\r[%s] %3.0f%%", bar.c_str(), 100 * done);
  std::string line = text;
  if (total_ > 1) line += " " + std::to_string(number_ + 1) + "/" + std::to_string(total_);
  const double file_elapsed = seconds(Clock::now() - file_started_);
  if (file_elapsed > 0 && share > 0) {
    std::snprintf(text, sizeof text, " %.1f Mtexel/s", 1e-6 * share * texels_ / file_elapsed);
    line += text;
  }
  if (done > 0.02 && elapsed > 1) {
    const long left = std::lround(elapsed * (1 - done) / done);
    std::snprintf(text, sizeof text, " %ld:%02ld left", left / 60, left % 60);
    line += text;
  }
  line += " " + name_;
  put(line + "\x1b[K");
  drawn_ = true;
}

void Progress::hide() {
  if (!drawn_) return;
  put("\r\x1b[K");
  drawn_ = false;
}

}  // namespace envconv::tool
