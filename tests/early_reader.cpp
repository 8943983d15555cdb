// SPDX-License-Identifier: Apache-2.0
// For the thread sanitizer, which ends a process that was forked where threads were: all test programs start the
// process that reads files before their first test.
#include <gtest/gtest.h>

#include "io.h"

namespace envconv {
namespace {

class EarlyReader : public testing::Environment {
  void SetUp() override { start_isolated_reader(); }
};

[[maybe_unused]] const testing::Environment* const early_reader = testing::AddGlobalTestEnvironment(new EarlyReader);

}  // namespace
}  // namespace envconv
