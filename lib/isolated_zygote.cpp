// SPDX-License-Identifier: Apache-2.0
#include "isolated_zygote.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <mutex>
#include <vector>

#include "exr.h"
#include "imageio_loader.h"
#include "io.h"
#include "isolated_child.h"
#include "isolated_messages.h"

namespace envconv {
namespace {

// --- the process ---------------------------------------------------------------------------------------------------

struct Child {
  pid_t pid;
  int socket;
};

constexpr int kControl = 3;  // the zygote's end of the socket to those who ask

// Whether the zygote loads the image library, once for all children.  A library that it needs (log4cplus) starts
// threads as it is loaded, and the thread sanitizer ends what is forked from several threads and starts some: there
// each child loads it.
#ifdef __SANITIZE_THREAD__
constexpr bool kLoadsImageio = false;
#else
constexpr bool kLoadsImageio = true;
#endif

// A process of its own: closed files, a name, signals as they were.  A descriptor that tells of children that ended.
int begin_zygote(int control) {
  // Nothing of the caller's stays open: a pipe's reader waits for its last writer.
  const int null = ::open("/dev/null", O_RDWR);
  for (int fd = 0; fd < 3; ++fd) ::dup2(null, fd);
  if (control != kControl) ::dup2(control, kControl);
  if (::syscall(SYS_close_range, kControl + 1, ~0u, 0) != 0) {
    for (int fd = kControl + 1; fd < 65536; ++fd) ::close(fd);
  }
  ::fcntl(kControl, F_SETFD, FD_CLOEXEC);
  ::prctl(PR_SET_NAME, "envconv-reader");
  for (int signal = 1; signal < 32; ++signal) ::signal(signal, SIG_DFL);
  // A terminal sends its interrupt to all processes; the caller decides what becomes of this one, by ending.
  for (const int signal : {SIGINT, SIGQUIT, SIGHUP, SIGTSTP, SIGPIPE}) ::signal(signal, SIG_IGN);
  sigset_t set;
  sigemptyset(&set);
  ::sigprocmask(SIG_SETMASK, &set, nullptr);
  sigaddset(&set, SIGCHLD);
  ::sigprocmask(SIG_BLOCK, &set, nullptr);
  const int signals = ::signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK);
  if (signals < 0) ::_exit(1);
  return signals;
}

// Tells the callers of children that ended how they did.
void reap(std::vector<Child>& children) {
  int status = 0;
  for (pid_t pid; (pid = ::waitpid(-1, &status, WNOHANG)) > 0;) {
    const auto child = std::find_if(children.begin(), children.end(), [&](const Child& c) { return c.pid == pid; });
    if (child == children.end()) continue;
    MessageWriter death(MessageKind::death);
    death.number(WIFSIGNALED(status) ? WTERMSIG(status) : 0);
    send_message(child->socket, death.bytes());
    ::close(child->socket);
    children.erase(child);
  }
}

// Forks a child for the next request; ends when nobody will ask any more.
void serve(std::vector<Child>& children, int signals) {
  std::string bytes;
  std::vector<int> fds;
  if (!receive_message(kControl, bytes, fds)) {
    for (const Child& child : children) ::kill(child.pid, SIGKILL);
    ::_exit(0);
  }
  MessageReader request(std::move(bytes));
  const auto kind = static_cast<MessageKind>(request.number(0, kMessageKinds - 1));
  const std::string format = request.text(64);
  DecoderOptions options;
  options.max_pixels = request.number(0, INT64_MAX);
  options.threads = static_cast<int>(request.number(1, 1024));
  options.level = static_cast<int>(request.number(INT32_MIN, INT32_MAX));
  options.library = request.number(0, 1) != 0;
  const std::string hook = request.text(64);
  if (kind != MessageKind::request || !request.good() || fds.size() != 2) {
    for (const int fd : fds) ::close(fd);
    return;
  }
  if (hook == "zygote") ::_exit(1);
  if (kLoadsImageio && (options.library || !has_own_reader(format)))
    (void)load_imageio();  // when it fails, the child says so
  const pid_t pid = ::fork();
  if (pid == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    ::prctl(PR_SET_DUMPABLE, 0);
    ::close(kControl);
    ::close(signals);
    for (const Child& child : children) ::close(child.socket);
    sigset_t none;
    sigemptyset(&none);
    ::sigprocmask(SIG_SETMASK, &none, nullptr);
    run_child(fds[1], fds[0], format, options, hook);
  }
  ::close(fds[0]);
  if (pid < 0) {
    send_message(fds[1], failure({ErrorCode::limit, "no process to decode it in"}).bytes());
    ::close(fds[1]);
  } else {
    children.push_back({pid, fds[1]});
  }
}

[[noreturn]] void run_zygote(int control) {
  const int signals = begin_zygote(control);
  std::vector<Child> children;
  for (;;) {
    std::vector<pollfd> polled{{kControl, POLLIN, 0}, {signals, POLLIN, 0}};
    for (const Child& child : children) polled.push_back({child.socket, 0, 0});  // only hang-ups
    if (::poll(polled.data(), polled.size(), -1) < 0 && errno != EINTR) ::_exit(1);
    for (std::size_t i = 0; i < children.size(); ++i) {
      if (polled[i + 2].revents & (POLLHUP | POLLERR)) ::kill(children[i].pid, SIGKILL);  // the caller has gone away
    }
    if (polled[1].revents & POLLIN) {
      signalfd_siginfo info;
      while (::read(signals, &info, sizeof info) > 0) {
      }
    }
    reap(children);
    if (polled[0].revents & (POLLIN | POLLHUP)) serve(children, signals);
  }
}

// --- those who ask it ----------------------------------------------------------------------------------------------

struct Zygote {
  std::mutex mutex;
  pid_t pid = -1;
  pid_t owner = -1;  // the process that started it: a host may fork
  int control = -1;
};

Zygote& zygote() {
  // Never destroyed: other threads may be reading while the process ends.
  static Zygote* const instance = new Zygote;
  return *instance;
}

// These with the mutex held.

void close_control(Zygote& z) {
  if (z.control >= 0) ::close(z.control);
  z.control = -1;
}

void start(Zygote& z) {
  close_control(z);
  // It ends when its socket does.  No signal: a host that reaps all its children may have freed the number for another.
  if (z.pid > 0 && z.owner == ::getpid()) ::waitpid(z.pid, nullptr, WNOHANG);
  z.pid = -1;
  int sockets[2];
  if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, sockets) != 0) return;
  // OpenEXR's threads would not be in the new process, which would wait for them.
  const int pool = exr_pool_threads();
  if (pool > 0) set_exr_pool_threads(0);
  const pid_t pid = ::fork();
  if (pid == 0) {
    ::close(sockets[0]);
    run_zygote(sockets[1]);
  }
  ::close(sockets[1]);
  if (pool > 0) set_exr_pool_threads(pool);
  if (pid < 0) {
    ::close(sockets[0]);
    return;
  }
  z.control = sockets[0];
  z.pid = pid;
  z.owner = ::getpid();
}

void start_unless_there(Zygote& z) {
  if (z.control < 0 || z.owner != ::getpid()) start(z);
}

}  // namespace

void start_isolated_reader() {
  Zygote& z = zygote();
  const std::lock_guard lock(z.mutex);
  start_unless_there(z);
}

pid_t ask_zygote(const std::string& request, int file, int socket) {
  Zygote& z = zygote();
  const std::lock_guard lock(z.mutex);
  start_unless_there(z);
  if (z.control >= 0 && send_message(z.control, request, {file, socket})) return z.pid;
  close_control(z);
  return -1;
}

void forget_zygote() {
  Zygote& z = zygote();
  const std::lock_guard lock(z.mutex);
  close_control(z);
}

}  // namespace envconv
