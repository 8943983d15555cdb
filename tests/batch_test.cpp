// SPDX-License-Identifier: Apache-2.0
// The scheduler of batches, with jobs that only pretend to work.
#include "batch.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <random>
#include <thread>
#include <vector>

namespace envconv::tool {
namespace {

// Some jobs take longer than others, in no order.
void pretend(int number) {
  std::minstd_rand random(static_cast<unsigned>(number) + 1);
  std::this_thread::sleep_for(std::chrono::microseconds(random() % 3000));
}

struct Watched {
  std::atomic<long> now{0}, most{0};
  void add(long n) {
    const long sum = now += n;
    long known = most;
    while (known < sum && !most.compare_exchange_weak(known, sum)) {
    }
  }
};

TEST(Batch, ReportsEachJobOnceAndInOrder) {
  for (const int threads : {1, 2, 7}) {
    Batch batch(60, threads, 1000, true);
    std::vector<int> reported;
    int ticks = 0;
    EXPECT_TRUE(batch.run({[](Batch::Turn& turn) {
                             pretend(turn.number());
                             return turn.number() % 7 != 3;
                           },
                           [&](int number) {
                             reported.push_back(number);
                             return true;
                           },
                           [&] { ++ticks; }}));
    ASSERT_EQ(reported.size(), 60u);
    for (int i = 0; i < 60; ++i) EXPECT_EQ(reported[static_cast<std::size_t>(i)], i);
    EXPECT_GT(ticks, 0);
  }
}

TEST(Batch, MemoryIsNeverExceededAndCoresAreNotShared) {
  constexpr long memory = 100;
  constexpr int threads = 4;
  Batch batch(80, threads, memory, true);
  Watched bytes, cores, at_once;
  std::atomic<int> large_alone{0};
  EXPECT_TRUE(batch.run({[&](Batch::Turn& turn) {
                           const long needed = 10 + turn.number() * 37 % 91;  // up to all of it
                           EXPECT_TRUE(turn.reserve(static_cast<std::size_t>(needed)));
                           bytes.add(needed);
                           at_once.add(1);
                           pretend(turn.number());
                           const bool large = turn.number() % 10 == 0;
                           const int got = turn.take_cores(large ? large_job_texels + 1 : 1000);
                           if (large) {
                             EXPECT_EQ(got, threads);
                             ++large_alone;
                           }
                           cores.add(got);
                           pretend(turn.number() + 1000);
                           cores.add(-got);
                           turn.release_cores();
                           bytes.add(-needed / 2);
                           turn.keep_only(static_cast<std::size_t>(needed - needed / 2));
                           pretend(turn.number() + 2000);
                           bytes.add(needed / 2 - needed);
                           at_once.add(-1);
                           return true;
                         },
                         [](int) { return true; }, [] {}}));
  EXPECT_LE(bytes.most, memory);
  EXPECT_LE(cores.most, threads);
  EXPECT_GT(at_once.most, 1);
  EXPECT_EQ(large_alone, 8);
}

TEST(Batch, AFailureLeavesWhatCameBeforeAndNothingElse) {
  for (const int threads : {1, 2, 7}) {
    for (int round = 0; round < 20; ++round) {
      Batch batch(40, threads, 1000, false);
      std::vector<std::atomic<bool>> committed(40);
      std::vector<int> reported;
      EXPECT_TRUE(batch.run({[&](Batch::Turn& turn) {
                               pretend(turn.number() + 40 * round);
                               if (turn.number() == 17) return false;
                               if (!turn.may_commit()) return false;
                               committed[static_cast<std::size_t>(turn.number())] = true;
                               return true;
                             },
                             [&](int number) {
                               reported.push_back(number);
                               return true;
                             },
                             [] {}}));
      ASSERT_EQ(reported.size(), 18u) << threads;
      for (std::size_t i = 0; i < committed.size(); ++i) EXPECT_EQ(committed[i], i < 17) << i;
    }
  }
}

TEST(Batch, StopsWhenToldTo) {
  Batch batch(200, 3, 1000, true);
  std::atomic<int> begun{0};
  int reports = 0;
  EXPECT_TRUE(batch.run({[&](Batch::Turn& turn) {
                           ++begun;
                           pretend(turn.number());
                           return true;
                         },
                         [&](int) { return ++reports < 5; }, [] {}}));
  EXPECT_LT(begun, 50);
}

TEST(Batch, AnErrorOfTheReporterReachesTheCaller) {
  Batch batch(20, 3, 1000, true);
  EXPECT_THROW((void)batch.run({[](Batch::Turn& turn) {
                                  pretend(turn.number());
                                  return true;
                                },
                                [](int number) -> bool {
                                  if (number == 4) throw std::bad_alloc();
                                  return true;
                                },
                                [] {}}),
               std::bad_alloc);
}

TEST(Batch, NoJobsAtAll) {
  Batch batch(0, 3, 1000, true);
  EXPECT_TRUE(batch.run({[](Batch::Turn&) { return true; }, [](int) { return true; }, [] {}}));
}

TEST(Batch, ProgressAddsUp) {
  Batch batch(3, 1, 1000, true);
  std::vector<double> seen;
  EXPECT_TRUE(batch.run({[&](Batch::Turn& turn) {
                           turn.advance(0.5, 10);
                           turn.advance(0.25, 10);  // a thread that is late
                           seen.push_back(batch.running_share());
                           turn.advance(1, 10);
                           return true;
                         },
                         [](int) { return true; }, [] {}}));
  EXPECT_EQ(seen, std::vector<double>({0.5, 0.5, 0.5}));
  EXPECT_EQ(batch.texels_done(), 30);
  EXPECT_EQ(batch.running_share(), 0);
}

}  // namespace
}  // namespace envconv::tool
