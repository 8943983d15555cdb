// SPDX-License-Identifier: Apache-2.0
// envconv completion: the script that teaches a shell our words.
#include "generate.h"
#include "text.h"

namespace envconv::tool {

Command completion_command() {
  Command command{.name = "completion",
                  .summary = "the shell's completion script",
                  .operands = "SHELL",
                  .min_operands = 1,
                  .max_operands = 1,
                  .description =
                      "Prints the completion script of a SHELL: bash, zsh or fish.  For bash: "
                      "source <(envconv completion bash)",
                  .operand_choices = completion_shells};
  command.run = [](const std::vector<std::string>& words) {
    const std::string script = completion_script(words.front());
    if (script.empty()) {
      complain(words.front() + ": no completions for this shell (there are: " + joined(completion_shells) + ")");
      return static_cast<int>(ErrorCode::usage);
    }
    print(script);
    return 0;
  };
  return command;
}

}  // namespace envconv::tool
