// SPDX-License-Identifier: Apache-2.0
// Signals that ask the process to end: SIGINT, SIGTERM, SIGHUP.  Whatever happens, no unfinished output stays.
#pragma once

namespace envconv::tool {

/// Takes the signals over, except those that the caller had us ignore (nohup, say).  Without a WindingUp they remove
/// the unfinished outputs and end the process at once.
void watch_signals();

/// While it lives, the first signal is only noted, so that whoever holds it can say what was done; it has half a second
/// for that.  A second signal ends the process at once.
class WindingUp {
 public:
  WindingUp();
  ~WindingUp();
  WindingUp(const WindingUp&) = delete;
  WindingUp& operator=(const WindingUp&) = delete;
};

/// The signal that was noted, or 0.
int noted_signal();

/// Removes the unfinished outputs; no new ones are begun.
void remove_unfinished();

/// Removes the unfinished outputs and dies of the signal, as the caller of this process expects.
[[noreturn]] void die_of(int signal_number);

}  // namespace envconv::tool
