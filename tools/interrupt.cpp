// SPDX-License-Identifier: Apache-2.0
#include "interrupt.h"

#include <sys/time.h>
#include <unistd.h>

#include <atomic>
#include <csignal>

#include "output_file.h"

namespace envconv::tool {
namespace {

// Lock-free atomics are what a handler may use.
std::atomic<int> noted{0};
std::atomic<bool> winding_up{false};
static_assert(std::atomic<int>::is_always_lock_free);

void end_by(int signal_number) {
  remove_temporaries();
  struct sigaction plain = {};
  plain.sa_handler = SIG_DFL;
  sigaction(signal_number, &plain, nullptr);
  raise(signal_number);  // from its own handler: delivered when that returns, which unblocks it
}

void on_signal(int signal_number) {
  int none = 0;
  if (winding_up && noted.compare_exchange_strong(none, signal_number)) {
    // Whoever is to wind up may be stuck, on a full pipe for one.
    constexpr itimerval half_a_second{{0, 0}, {0, 500000}};
    setitimer(ITIMER_REAL, &half_a_second, nullptr);
    return;
  }
  end_by(signal_number);
}

void on_deadline(int) { end_by(noted != 0 ? noted.load() : SIGALRM); }

void handle(int signal_number, void (*handler)(int)) {
  struct sigaction action = {};
  action.sa_handler = handler;
  action.sa_flags = SA_RESTART;  // codecs do not expect EINTR
  sigemptyset(&action.sa_mask);
  sigaction(signal_number, &action, nullptr);
}

}  // namespace

void watch_signals() {
  for (const int signal_number : {SIGINT, SIGTERM, SIGHUP}) {
    struct sigaction old = {};
    sigaction(signal_number, nullptr, &old);
    if (old.sa_handler != SIG_IGN) handle(signal_number, on_signal);
  }
  handle(SIGALRM, on_deadline);
  // A reader of our output that goes away must not kill us in the middle of a file; write() says EPIPE instead.
  std::signal(SIGPIPE, SIG_IGN);
  // A file that grows beyond ulimit -f is an error of the call that let it.
  std::signal(SIGXFSZ, SIG_IGN);
}

WindingUp::WindingUp() { winding_up = true; }
WindingUp::~WindingUp() {
  winding_up = false;
  if (noted != 0) die_of(noted);
}

int noted_signal() { return noted; }

void remove_unfinished() { remove_temporaries(); }

void die_of(int signal_number) {
  end_by(signal_number);
  _exit(128 + signal_number);  // a signal that is blocked
}

}  // namespace envconv::tool
