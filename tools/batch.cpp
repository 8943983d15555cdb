// SPDX-License-Identifier: Apache-2.0
#include "batch.h"

#include <malloc.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <numeric>
#include <thread>

namespace envconv::tool {

Batch::Batch(int jobs, int threads, std::size_t memory, bool keep_going)
    : count_(jobs),
      threads_(threads),
      memory_(memory),
      keep_going_(keep_going),
      states_(static_cast<std::size_t>(jobs), State::waiting),
      shares_(states_.size(), 0.0),
      texels_(states_.size(), 0.0),
      asked_(states_.size(), false),
      held_(states_.size(), 0),
      free_cores_(threads) {}

// --- a job's turn --------------------------------------------------------------------------------------------------

bool Batch::Turn::reserve(std::size_t bytes) {
  Batch& b = batch_;
  std::unique_lock lock(b.mutex_);
  // Whoever has nothing to wait for but jobs that began before it gets its turn in the end.
  b.changed_.wait(lock, [&] {
    return b.unwanted(number_) ||
           (b.turn_for_memory_ == number_ && (b.used_ == 0 || bytes <= b.memory_ - std::min(b.used_, b.memory_)));
  });
  if (b.unwanted(number_)) return false;
  b.used_ += bytes;
  b.held_[static_cast<std::size_t>(number_)] = bytes;
  b.asked_[static_cast<std::size_t>(number_)] = true;
  while (b.turn_for_memory_ < b.count_ && b.asked_[static_cast<std::size_t>(b.turn_for_memory_)]) ++b.turn_for_memory_;
  b.changed_.notify_all();
  return true;
}

void Batch::Turn::keep_only(std::size_t bytes) {
  const std::lock_guard lock(batch_.mutex_);
  std::size_t& held = batch_.held_[static_cast<std::size_t>(number_)];
  if (bytes >= held) return;
  batch_.used_ -= held - bytes;
  held = bytes;
  batch_.changed_.notify_all();
}

int Batch::Turn::take_cores(std::int64_t texels) {
  Batch& b = batch_;
  std::unique_lock lock(b.mutex_);
  const std::uint64_t ticket = b.core_tickets_++;
  const auto wanted = [&] {
    // The last few small jobs share what the others no longer use.
    const int left = b.count_ - b.next_ + b.running_;
    return texels > large_job_texels ? b.threads_ : std::max(1, b.threads_ / std::max(1, left));
  };
  b.changed_.wait(lock, [&] { return b.core_turn_ == ticket && b.free_cores_ >= wanted(); });
  cores_ = wanted();
  b.free_cores_ -= cores_;
  ++b.core_turn_;
  b.changed_.notify_all();
  return cores_;
}

void Batch::Turn::release_cores() {
  const std::lock_guard lock(batch_.mutex_);
  batch_.free_cores_ += cores_;
  cores_ = 0;
  batch_.changed_.notify_all();
}

bool Batch::Turn::may_commit() {
  Batch& b = batch_;
  if (b.keep_going_) return !cancelled();
  std::unique_lock lock(b.mutex_);
  b.changed_.wait(lock, [&] { return b.unwanted(number_) || b.succeeded_ >= number_; });
  return !b.unwanted(number_);
}

bool Batch::Turn::cancelled() const {
  const std::lock_guard lock(batch_.mutex_);
  return batch_.unwanted(number_);
}

void Batch::Turn::advance(double share, double texels) {
  const std::lock_guard lock(batch_.mutex_);
  // Reports of several threads arrive in any order.
  double& known = batch_.shares_[static_cast<std::size_t>(number_)];
  known = std::max(known, std::clamp(share, 0.0, 1.0));
  batch_.texels_[static_cast<std::size_t>(number_)] = texels;
}

// --- all jobs ------------------------------------------------------------------------------------------------------

void Batch::end_job(Turn& turn, bool succeeded) {
  const auto number = static_cast<std::size_t>(turn.number_);
  if (turn.cores_ > 0) turn.release_cores();
  turn.keep_only(0);
  const std::lock_guard lock(mutex_);
  asked_[number] = true;
  while (turn_for_memory_ < count_ && asked_[static_cast<std::size_t>(turn_for_memory_)]) ++turn_for_memory_;
  states_[number] = succeeded ? State::succeeded : State::failed;
  while (succeeded_ < count_ && states_[static_cast<std::size_t>(succeeded_)] == State::succeeded) ++succeeded_;
  if (!succeeded && !keep_going_) first_failed_ = std::min(first_failed_, turn.number_);
  --running_;
  changed_.notify_all();
}

void Batch::run_jobs(const Callbacks& callbacks) {
  for (;;) {
    int number;
    {
      const std::lock_guard lock(mutex_);
      if (next_ >= count_ || unwanted(next_)) return;
      number = next_++;
      states_[static_cast<std::size_t>(number)] = State::running;
      ++running_;
    }
    Turn turn(*this, number);
    const bool succeeded = callbacks.work(turn);
    end_job(turn, succeeded);
  }
}

bool Batch::run(const Callbacks& callbacks) {
  // An image that was freed goes back to the system, instead of staying with the thread that held it: glibc would
  // otherwise keep up to 32 MB images, for each thread (measured: 300 MB where 65 were in use).
  mallopt(M_MMAP_THRESHOLD, 1 << 20);
  // What the library's loops use besides the threads below.
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads_));
  // Whatever happens here, the threads end before what they work on does.
  struct Workers {
    Batch& batch;
    std::vector<std::thread> threads;
    ~Workers() {
      {
        const std::lock_guard lock(batch.mutex_);
        batch.stopped_ = true;
        batch.changed_.notify_all();
      }
      for (std::thread& thread : threads) thread.join();
    }
  } workers{*this, {}};
  const int wanted = std::min(count_, threads_ == 1 ? 1 : threads_ + 1);
  workers.threads.reserve(static_cast<std::size_t>(wanted));
  try {
    for (int i = 0; i < wanted; ++i) workers.threads.emplace_back([&] { run_jobs(callbacks); });
  } catch (const std::exception&) {
    if (workers.threads.empty()) return false;  // fewer do as well
  }
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait_for(lock, std::chrono::milliseconds(50), [&] {
      return (reported_ < count_ && has_ended(reported_)) || (running_ == 0 && (next_ >= count_ || unwanted(next_)));
    });
    while (reported_ < count_ && reported_ <= first_failed_ && has_ended(reported_)) {
      const int number = reported_++;
      lock.unlock();
      const bool go_on = callbacks.report(number);
      lock.lock();
      if (!go_on) stopped_ = true;
      changed_.notify_all();
    }
    const bool all_ended = running_ == 0 && (next_ >= count_ || unwanted(next_));
    const bool all_reported = reported_ >= next_ || reported_ > first_failed_;
    lock.unlock();
    callbacks.tick();
    if (all_ended && all_reported) break;
    lock.lock();
  }
  return true;
}

double Batch::running_share() {
  const std::lock_guard lock(mutex_);
  double sum = 0;
  for (std::size_t i = 0; i < states_.size(); ++i) {
    if (states_[i] == State::running) sum += shares_[i];
  }
  return sum;
}

double Batch::texels_done() {
  const std::lock_guard lock(mutex_);
  return std::inner_product(shares_.begin(), shares_.end(), texels_.begin(), 0.0);
}

std::vector<int> Batch::ended_unreported() {
  const std::lock_guard lock(mutex_);
  std::vector<int> found;
  for (int i = reported_; i < next_; ++i) {
    if (has_ended(i) && i <= first_failed_) found.push_back(i);
  }
  return found;
}

}  // namespace envconv::tool
