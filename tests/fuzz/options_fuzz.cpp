// SPDX-License-Identifier: Apache-2.0
// Command lines: a verb and its words, one a line.  Nothing is run.
#include <cstdint>
#include <cstdlib>
#include <string>
#include <vector>

#include "command.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace envconv::tool;
  std::vector<std::string> words(1);
  for (std::size_t i = 0; i < size; ++i) {
    // A command line holds no zero bytes.
    if (data[i] == '\n') {
      words.emplace_back();
    } else if (data[i] != 0) {
      words.back() += static_cast<char>(data[i]);
    }
  }
  const Command* command = find_command(words.front());
  if (!command) return 0;
  words.erase(words.begin());
  const auto parsed = parse(*command, words);
  // What is wrong is said in words, and is the caller's fault.
  if (!parsed && (parsed.error().code != envconv::ErrorCode::usage || parsed.error().message.empty())) std::abort();
  return 0;
}
