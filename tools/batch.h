// SPDX-License-Identifier: Apache-2.0
// Many jobs at once, on the threads that this owns: the one place of the tool that has any.
//
//   - Jobs begin in order, on one thread more than there are cores to work with, so that while some compute another
//     waits for a disk or for a decoder's process.  With one thread they run one after another.
//   - Within a job, decoding and encoding run when they like; the part between them waits for cores, in the order of
//     asking.  A small job takes one core, and many run side by side; a large one takes all.
//   - Memory is granted in the jobs' order, before any of it is allocated.  A job that would fit alone waits until it
//     fits; one that never would is told so.
//   - With in_order, outputs take their names in the jobs' order, so that a failure leaves exactly the outputs of the
//     jobs before it, whatever the number of threads.
//   - Jobs are reported in their order.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <mutex>
#include <vector>

namespace envconv::tool {

/// A job with more texels than this, of input and output together, has all cores to itself.
inline constexpr std::int64_t large_job_texels = std::int64_t{1} << 22;

class Batch {
 public:
  /// What a job asks of its batch, from the thread that runs it.
  class Turn {
   public:
    int number() const { return number_; }
    /// Cores that a job may be given.
    int threads() const { return batch_.threads_; }
    /// Bytes that all jobs together may hold.
    std::size_t memory() const { return batch_.memory_; }
    /// Waits until `bytes`, at most memory(), are free.  Called at most once.  False when the job is not wanted any
    /// more.
    bool reserve(std::size_t bytes);
    /// Gives back all but `bytes` of what was reserved.
    void keep_only(std::size_t bytes);
    /// Waits for cores for so many texels; how many it got, until release_cores().
    int take_cores(std::int64_t texels);
    void release_cores();
    /// Waits until the output may take its name.  False when the job is not wanted any more.
    bool may_commit();
    /// True when an earlier job failed and the batch stops at failures.
    bool cancelled() const;
    /// The share of the job that is done, 0 to 1, out of so many texels.  From any thread.
    void advance(double share, double texels);

   private:
    friend class Batch;
    Turn(Batch& batch, int number) : batch_(batch), number_(number) {}
    Batch& batch_;
    const int number_;
    int cores_ = 0;
  };

  /// What the user of a batch gives it.
  struct Callbacks {
    /// Does a job, on some thread; true when it succeeded.  Must not throw.
    std::function<bool(Turn&)> work;
    /// Told of a job that has ended, in order, on the thread of run().  False: no further job is to begin.
    std::function<bool(int number)> report;
    /// Called on the thread of run() about 20 times a second.
    std::function<void()> tick;
  };

  /// `threads` >= 1 cores to work with.  Without `keep_going` the batch stops at the first job that fails.
  Batch(int jobs, int threads, std::size_t memory, bool keep_going);
  Batch(const Batch&) = delete;
  Batch& operator=(const Batch&) = delete;

  /// Runs all jobs.  False when no thread could be had.
  bool run(const Callbacks& callbacks);

  /// For tick(): shares of the jobs that run, added up, and texels done.
  double running_share();
  double texels_done();
  /// Jobs that have ended, in order, whether they were reported or not.  For tick(): a report may then be made before
  /// its turn.
  std::vector<int> ended_unreported();

 private:
  enum class State : std::uint8_t { waiting, running, succeeded, failed };
  void run_jobs(const Callbacks& callbacks);
  void end_job(Turn& turn, bool succeeded);
  bool unwanted(int number) const { return number > first_failed_ || stopped_; }
  bool has_ended(int number) const {
    const State s = states_[static_cast<std::size_t>(number)];
    return s == State::succeeded || s == State::failed;
  }

  const int count_, threads_;
  const std::size_t memory_;
  const bool keep_going_;

  std::mutex mutex_;
  std::condition_variable changed_;  // anything below
  std::vector<State> states_;
  std::vector<double> shares_, texels_;  // of each job
  std::vector<bool> asked_;              // for memory, or never will
  std::vector<std::size_t> held_;        // bytes
  std::size_t used_ = 0;                 // bytes, of all jobs
  int next_ = 0;                         // job to begin
  int turn_for_memory_ = 0;              // all jobs before it have asked
  int succeeded_ = 0;                    // so many jobs from the first on
  int reported_ = 0;
  int running_ = 0;
  int first_failed_ = std::numeric_limits<int>::max();
  bool stopped_ = false;
  std::uint64_t core_tickets_ = 0, core_turn_ = 0;
  int free_cores_;
};

}  // namespace envconv::tool
