// SPDX-License-Identifier: Apache-2.0
//
// Three kinds of process take part:
//   the caller    asks, checks every answer, owns the memory that pixels arrive in;
//   the zygote    forked once, single-threaded, forks a child for each file and reaps it;
//   the child     decodes one file under limits and ends.
// The caller and a child talk over a socket pair made for the file; the zygote keeps the child's end as well, so that
// it can say how the child died, and so that it notices when the caller has gone away.  The zygote opens no file and
// runs no codec.  It loads the image library once, on the first request that needs it, since that costs a quarter of a
// second.
//
// A child that works for ever reaches its limit of processor time, which the system keeps; one that is stuck takes
// none, which the caller sees while it waits.  Neither counts time in which all are stopped, or wait for a processor.
#include "isolated_reader.h"

#include <fcntl.h>
#include <malloc.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <optional>
#include <vector>

#include "exr.h"
#include "imageio_loader.h"
#include "isolated_messages.h"

namespace envconv {
namespace {

constexpr int kOpenSeconds = 20;   // of processor time, to understand a header
constexpr int kStuckSeconds = 20;  // without any processor time

// --- the child -----------------------------------------------------------------------------------------------------

// What the process has mapped; without /proc, what it has with the image library loaded, and more.
std::size_t address_space() {
  std::size_t pages = 0;
  if (std::FILE* file = std::fopen("/proc/self/statm", "r")) {
    if (std::fscanf(file, "%zu", &pages) != 1) pages = 0;
    std::fclose(file);
  }
  return pages > 0 ? pages * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE)) : std::size_t{4} << 30;
}

void limit_resource(int resource, std::uint64_t value) {
  // The hard limit stays: the limits are raised once, when the size of the picture is known.
  rlimit limit{};
  ::getrlimit(static_cast<__rlimit_resource>(resource), &limit);
  limit.rlim_cur = std::min<rlim_t>(value, limit.rlim_max);
  ::setrlimit(static_cast<__rlimit_resource>(resource), &limit);
}

struct Plan {
  std::size_t bytes = 0;  // of the mapping
  std::vector<std::size_t> offsets;
};

// Each picture on its own pages.
Plan plan_of(const FileSpec& spec) {
  Plan plan;
  for (const PictureSpec& picture : spec.pictures) {
    plan.offsets.push_back(plan.bytes);
    plan.bytes += bytes_of(picture);
  }
  return plan;
}

// For pictures that go elsewhere, the memory that both sides share: two places, each for the largest band of rows of
// all pictures, so that one band is decoded while the one before is copied.
struct Window {
  std::size_t place = 0;  // bytes
  explicit Window(const FileSpec& spec) {
    for (const PictureSpec& picture : spec.pictures) {
      const std::size_t bytes = bytes_of_rows(picture, rows_at_a_time(picture));
      place = std::max(place, (bytes + 65535) / 65536 * 65536);
      two = two || picture.band > 0 || spec.pictures.size() > 1;
    }
  }
  std::size_t bytes() const { return two ? 2 * place : place; }
  std::size_t offset(std::int64_t turn) const { return two && turn % 2 ? place : 0; }

 private:
  bool two = false;
};

// Seconds of processor time that a thread of a decoder may take.
int decode_seconds(const FileSpec& spec) {
  double values = 0;
  for (const PictureSpec& picture : spec.pictures) {
    values += static_cast<double>(picture.width) * picture.height * picture.channels.count();
  }
  return static_cast<int>(std::min(20 + values / 500e3, 86400.));
}

// What both ways of decoding have in common: memory that is shared with the caller, and limits for decoding.
class ChildsMemory {
 public:
  ChildsMemory(int shared, std::size_t bytes, const FileSpec& spec, std::uint64_t base, int threads) {
    const auto seconds = static_cast<std::uint64_t>(decode_seconds(spec));
    limit_resource(RLIMIT_CPU, seconds * static_cast<std::uint64_t>(threads) + kOpenSeconds);
    // What is shared, and for the codec's own copies three times the pictures, as some hold all of them.
    limit_resource(RLIMIT_AS, base + bytes + 3 * plan_of(spec).bytes);
    mapping_ = MappedMemory::of_file(shared, 0, bytes);
    if (!mapping_.data()) throw std::bad_alloc();
  }
  char* at(std::size_t offset) const { return static_cast<char*>(mapping_.data()) + offset; }

 private:
  MappedMemory mapping_;
};

// Decodes all pictures.
Result<Ok> decode_all_for_caller(int shared, Decoder& decoder, std::uint64_t base, int threads) {
  const FileSpec& spec = decoder.spec();
  const Plan plan = plan_of(spec);
  const ChildsMemory memory(shared, plan.bytes, spec, base, threads);
  for (std::size_t i = 0; i < spec.pictures.size(); ++i)
    ENVCONV_CHECK(decoder.decode(static_cast<int>(i), memory.at(plan.offsets[i])));
  return Ok{};
}

// Decodes the rows that the caller asks for, and says so each time, until it has enough.
Result<Ok> decode_rows_for_caller(int socket, int shared, Decoder& decoder, std::uint64_t base, int threads) {
  const FileSpec& spec = decoder.spec();
  const Window window(spec);
  const ChildsMemory memory(shared, window.bytes(), spec, base, threads);
  std::string bytes;
  std::vector<int> fds;
  for (std::int64_t turn = 0;; ++turn) {
    if (!receive_message(socket, bytes, fds)) ::_exit(0);
    MessageReader request(std::move(bytes));
    const auto kind = static_cast<MessageKind>(request.number(0, kMessageKinds - 1));
    const auto number = static_cast<int>(request.number(0, static_cast<std::int64_t>(spec.pictures.size()) - 1));
    const PictureSpec& picture = spec.pictures[static_cast<std::size_t>(number)];
    const auto first = static_cast<int>(request.number(0, picture.height - 1));
    const auto count = static_cast<int>(request.number(1, picture.height - first));
    if (kind != MessageKind::rows || !request.good()) ::_exit(0);
    char* const to = memory.at(window.offset(turn));
    if (turn > 1) std::memset(to, 0, bytes_of_rows(picture, count));
    ENVCONV_CHECK(decoder.decode_rows(number, first, count, to));
    if (!send_message(socket, MessageWriter(MessageKind::done).bytes())) ::_exit(0);
  }
}

[[noreturn]] void run_child(int socket, int file, const std::string& format, const DecoderOptions& options,
                            const std::string& hook) {
  const auto finish = [&](const std::string& message) {
    send_message(socket, message);
    ::_exit(0);
  };
  try {
    MessageWriter started(MessageKind::started);
    started.number(::getpid());
    if (!send_message(socket, started.bytes())) ::_exit(0);
    // OpenEXR uses memory it never wrote when a chunk inflates short, and so does HEIF's codec where its stream is
    // damaged; what comes out must be the same every time.  The image library allocates 60 MB to read the smallest
    // file, which this would fill.
    if (format == "openexr" || format == "heif") ::mallopt(M_PERTURB, 0xFF);
    struct stat info {};
    const std::uint64_t file_size = ::fstat(file, &info) == 0 ? static_cast<std::uint64_t>(info.st_size) : 0;
    const auto threads = static_cast<std::uint64_t>(std::max(options.threads, 1));
    const std::uint64_t base = address_space() + (std::uint64_t{1} << 30) + file_size * 4 + threads * (200u << 20);
    limit_resource(RLIMIT_CORE, 0);
    limit_resource(RLIMIT_FSIZE, 0);
    limit_resource(RLIMIT_AS, base);
    limit_resource(RLIMIT_CPU, hook == "spin" ? 1 : kOpenSeconds);
    if (hook == "crash") std::raise(SIGSEGV);
    while (hook == "spin") address_space();
    while (hook == "hang") ::pause();
    if (hook == "pause") ::sleep(1);
    if (hook == "exit") ::_exit(1);
    if (hook == "rubbish") finish(std::string(5000, '\x7F'));
    auto decoder = open_decoder(format, file, options);
    if (!decoder) finish(failure(decoder.error()).bytes());
    const FileSpec& spec = (*decoder)->spec();
    const std::string packed = pack(spec);
    if (packed.size() > kMaxMessage - 1024) finish(failure({ErrorCode::input, "has too much metadata"}).bytes());
    if (!send_message(socket, packed)) ::_exit(1);
    std::string bytes;
    std::vector<int> fds;
    if (!receive_message(socket, bytes, fds) || fds.size() != 1) ::_exit(0);  // the header was all that was wanted
    const bool whole =
        static_cast<MessageKind>(MessageReader(std::move(bytes)).number(0, kMessageKinds - 1)) == MessageKind::go;
    const auto result = whole ? decode_all_for_caller(fds[0], **decoder, base, static_cast<int>(threads))
                              : decode_rows_for_caller(socket, fds[0], **decoder, base, static_cast<int>(threads));
    finish(result ? MessageWriter(MessageKind::done).bytes() : failure(result.error()).bytes());
  } catch (const std::bad_alloc&) {
    finish(failure({ErrorCode::limit, "not enough memory to decode it"}).bytes());
  } catch (...) {
    finish(failure({ErrorCode::input, "truncated or damaged"}).bytes());
  }
  ::_exit(1);
}

// --- the zygote ----------------------------------------------------------------------------------------------------

struct Child {
  pid_t pid;
  int socket;
};

[[noreturn]] void run_zygote(int control) {
  // Nothing of the caller's stays open: a pipe's reader waits for its last writer.
  const int null = ::open("/dev/null", O_RDWR);
  for (int fd = 0; fd < 3; ++fd) ::dup2(null, fd);
  constexpr int kControl = 3;
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
    if (!(polled[0].revents & (POLLIN | POLLHUP))) continue;
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
    const std::string hook = request.text(64);
    if (kind != MessageKind::request || !request.good() || fds.size() != 2) {
      for (const int fd : fds) ::close(fd);
      continue;
    }
    if (hook == "zygote") ::_exit(1);
    if (needs_imageio(format)) (void)load_imageio();  // when it fails, the child says so
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
}

// --- the caller ----------------------------------------------------------------------------------------------------

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

// With the mutex held.
bool start(Zygote& z) {
  if (z.control >= 0) ::close(z.control);
  z.control = -1;
  // It ends when its socket does.  No signal: a host that reaps all its children may have freed the number for another.
  if (z.pid > 0 && z.owner == ::getpid()) ::waitpid(z.pid, nullptr, WNOHANG);
  z.pid = -1;
  int sockets[2];
  if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, sockets) != 0) return false;
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
    return false;
  }
  z.control = sockets[0];
  z.pid = pid;
  z.owner = ::getpid();
  return true;
}

Error took_too_long() {
  return {ErrorCode::input, "the reader was stopped after taking too long (damaged, or made to do harm)"};
}

Error crashed(int signal) {
  if (signal == SIGXCPU) return took_too_long();
  std::string how = "ended early";
  if (signal != 0) {
    const char* name = ::sigabbrev_np(signal);
    how.assign("crashed (SIG").append(name ? name : "?").append(")");
  }
  return {ErrorCode::input, how.insert(0, "the reader ").append("; the file is damaged, or made to do harm")};
}

class IsolatedReader final : public PixelSource {
 public:
  ~IsolatedReader() override {
    if (socket_ >= 0) ::close(socket_);  // the zygote ends the child
  }

  Result<Ok> open(const std::string& format, int fd, const DecoderOptions& options) {
    MessageWriter request(MessageKind::request);
    request.text(format);
    request.number(options.max_pixels);
    request.number(options.threads);
    request.number(options.level);
    const char* hook = std::getenv("ENVCONV_TEST_READER");  // tests make a child misbehave
    request.text(hook ? hook : "");
    if (hook) stuck_seconds_ = 2;
    Error error{ErrorCode::internal, "no process to decode it in"};
    // A zygote that died is replaced, once.
    for (int attempt = 0; attempt < 2; ++attempt) {
      int sockets[2];
      if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, sockets) != 0) {
        return Error{ErrorCode::limit, std::string("no socket: ") + std::strerror(errno)};
      }
      bool sent = false;
      {
        Zygote& z = zygote();
        const std::lock_guard lock(z.mutex);
        if (z.control < 0 || z.owner != ::getpid()) start(z);
        if (z.control >= 0) sent = send_message(z.control, request.bytes(), {fd, sockets[1]});
        child_ = z.pid;  // until it has one, which is after the image library was loaded
        if (!sent) {
          if (z.control >= 0) ::close(z.control);
          z.control = -1;
        }
      }
      ::close(sockets[1]);
      if (socket_ >= 0) ::close(socket_);
      socket_ = sockets[0];
      if (!sent) continue;
      MessageReader reply("");
      MessageKind kind = MessageKind::death;
      auto got = receive(kOpenSeconds, kind, reply);
      if (got && kind == MessageKind::started) {
        child_ = static_cast<pid_t>(reply.number(1, INT32_MAX));
        got = receive(kOpenSeconds, kind, reply);
      }
      if (!got) {
        error = got.error();
        // No word at all, not even of a death: the zygote is gone.
        if (!silent_) return error;
        Zygote& z = zygote();
        const std::lock_guard lock(z.mutex);
        if (z.control >= 0) ::close(z.control);
        z.control = -1;
        continue;
      }
      if (kind != MessageKind::spec || !unpack(reply, spec_)) return senseless();
      theirs_ = spec_;
      // What the child decodes whole can be taken in bands all the same.
      for (PictureSpec& picture : spec_.pictures) {
        if (picture.band == 0) picture.band = band_rows(picture, 1);
      }
      return Ok{};
    }
    return error;
  }

  const FileSpec& spec() const override { return spec_; }

  Result<MappedMemory> pixels(int picture) override {
    if (memory_.empty()) ENVCONV_CHECK(decode_all());
    return std::move(memory_[static_cast<std::size_t>(picture)]);
  }

  Result<Ok> decode_rows(int picture, int first, int count, void* pixels) override {
    ENVCONV_CHECK(share_window());
    const PictureSpec& p = spec_.pictures[static_cast<std::size_t>(picture)];
    auto* to = static_cast<char*>(pixels);
    while (count > 0) {
      ENVCONV_CHECK(await(picture, first));
      const int rows = std::min(count, ready_.end - first);
      copy(first, rows, to);
      to += bytes_of_rows(p, rows);
      first += rows;
      count -= rows;
    }
    return Ok{};
  }

 private:
  static Error senseless() {
    return {ErrorCode::input, "the reader gave a senseless answer; the file is damaged, or made to do harm"};
  }

  // So many bytes that both sides will see: a descriptor for the child, which is closed after it was sent.
  static Result<int> shared_file(std::size_t bytes) {
    const int fd = static_cast<int>(::memfd_create("envconv-pixels", MFD_CLOEXEC | MFD_ALLOW_SEALING));
    if (fd < 0) return Error{ErrorCode::limit, std::string("no shared memory: ") + std::strerror(errno)};
    // Sealed: a child that shrank it would make this process die on the next access.
    if (::ftruncate(fd, static_cast<off_t>(bytes)) == 0 &&
        ::fcntl(fd, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL) == 0)
      return fd;
    ::close(fd);
    return no_memory_for(bytes);
  }

  Result<Ok> decode_all() {
    const Plan plan = plan_of(spec_);
    ENVCONV_TRY(const int fd, shared_file(plan.bytes));
    bool mapped = true;
    for (std::size_t i = 0; mapped && i < plan.offsets.size(); ++i) {
      memory_.push_back(MappedMemory::of_file(fd, plan.offsets[i], bytes_of(spec_.pictures[i])));
      mapped = memory_.back().data() != nullptr;
    }
    const bool sent = mapped && send_message(socket_, MessageWriter(MessageKind::go).bytes(), {fd});
    ::close(fd);
    if (!mapped) return no_memory_for(plan.bytes);
    MessageReader reply("");
    MessageKind kind = MessageKind::death;
    ENVCONV_CHECK(receive(sent ? decode_seconds(spec_) : 1, kind, reply));
    if (kind != MessageKind::done) return senseless();
    // The memory is used as it is, so nobody may write there any more.
    ended_ = true;
    ENVCONV_CHECK(receive(kOpenSeconds, kind, reply));
    if (kind != MessageKind::death) return senseless();
    return Ok{};
  }

  Result<Ok> share_window() {
    if (window_) return Ok{};
    const Window window(theirs_);
    ENVCONV_TRY(const int fd, shared_file(window.bytes()));
    shared_ = MappedMemory::of_file(fd, 0, window.bytes());
    if (shared_.data()) send_message(socket_, MessageWriter(MessageKind::window).bytes(), {fd});
    ::close(fd);
    if (!shared_.data()) return no_memory_for(window.bytes());
    window_ = window;
    ask({0, 0, rows_at_a_time(theirs_.pictures[0])});
    return Ok{};
  }

  // Rows [begin, end) of a picture.
  struct Band {
    int picture = -1, begin = 0, end = 0;
  };

  // What cannot be sent is found when the answer is awaited.
  void ask(Band band) {
    MessageWriter request(MessageKind::rows);
    request.number(band.picture);
    request.number(band.begin);
    request.number(band.end - band.begin);
    asked_ = band;
    ++turn_;
    send_message(socket_, request.bytes());
  }

  // Makes the band ready that holds a row, which comes after all that were asked for before; the one after it is
  // decoded in the meantime.
  Result<Ok> await(int picture, int row) {
    while (ready_.picture != picture || row >= ready_.end) {
      ENVCONV_CHECK(receive_done());
      ready_ = asked_;
      ready_place_ = static_cast<char*>(shared_.data()) + window_->offset(turn_);
      forgotten_ = 0;
      Band next{ready_.picture, ready_.end, 0};
      if (next.begin == theirs_.pictures[static_cast<std::size_t>(next.picture)].height)
        next = {next.picture + 1, 0, 0};
      if (static_cast<std::size_t>(next.picture) == theirs_.pictures.size()) continue;
      const PictureSpec& p = theirs_.pictures[static_cast<std::size_t>(next.picture)];
      next.end = std::min(next.begin + rows_at_a_time(p), p.height);
      ask(next);
    }
    return Ok{};
  }

  // Rows of the band that is ready.  As they are copied, what was decoded whole is given back, and what will be used
  // again is unmapped: there are never two pictures in this process.
  void copy(int first, int rows, char* to) {
    constexpr std::size_t piece = std::size_t{1} << 20;
    const PictureSpec& p = theirs_.pictures[static_cast<std::size_t>(ready_.picture)];
    std::size_t at = bytes_of_rows(p, first - ready_.begin);
    for (const std::size_t end = at + bytes_of_rows(p, rows); at < end;) {
      const std::size_t size = std::min(piece, end - at);
      std::memcpy(to, ready_place_ + at, size);
      to += size;
      at += size;
      const std::size_t whole_pages = at / 4096 * 4096;
      if (whole_pages <= forgotten_) continue;
      ::madvise(ready_place_ + forgotten_, whole_pages - forgotten_, p.band > 0 ? MADV_DONTNEED : MADV_REMOVE);
      forgotten_ = whole_pages;
    }
  }

  Result<Ok> receive_done() {
    MessageReader reply("");
    MessageKind kind = MessageKind::death;
    ENVCONV_CHECK(receive(decode_seconds(spec_), kind, reply));
    return kind == MessageKind::done ? Result<Ok>(Ok{}) : senseless();
  }

  // What a child says that may take so many seconds of processor time: that it started, a spec or done, and then its
  // death.  Failures, and deaths before, are errors.
  Result<Ok> receive(int seconds, MessageKind& kind, MessageReader& reply) {
    silent_ = false;
    if (!wait_for_message(socket_, child_, stuck_seconds_, seconds)) return took_too_long();
    std::string bytes;
    std::vector<int> fds;
    const bool received = receive_message(socket_, bytes, fds);
    for (const int fd : fds) ::close(fd);  // a child has none to send
    if (!received) {
      silent_ = true;
      return crashed(0);
    }
    reply = MessageReader(std::move(bytes));
    kind = static_cast<MessageKind>(reply.number(0, kMessageKinds - 1));
    if (kind == MessageKind::failure) return unpack_failure(reply);
    if (kind == MessageKind::death && !ended_) return crashed(static_cast<int>(reply.number(0, 64)));
    return reply.good() ? Result<Ok>(Ok{}) : senseless();
  }

  int socket_ = -1;
  pid_t child_ = -1;
  double stuck_seconds_ = kStuckSeconds;
  bool silent_ = false;
  FileSpec spec_, theirs_;            // as this delivers pictures in bands, and as the child does
  std::vector<MappedMemory> memory_;  // of each picture that was decoded whole, until it is asked for
  bool ended_ = false;                // the child has done all it should
  std::optional<Window> window_;
  MappedMemory shared_;     // the window
  std::int64_t turn_ = -1;  // of the band that was asked for last
  Band asked_, ready_;
  char* ready_place_ = nullptr;
  std::size_t forgotten_ = 0;  // bytes of the ready band that are not mapped any more
};

}  // namespace

void start_isolated_reader() {
  Zygote& z = zygote();
  const std::lock_guard lock(z.mutex);
  if (z.control < 0 || z.owner != ::getpid()) start(z);
}

Result<std::unique_ptr<PixelSource>> open_isolated(const std::string& format, int fd, const DecoderOptions& options) {
  auto reader = std::make_unique<IsolatedReader>();
  ENVCONV_CHECK(reader->open(format, fd, options));
  return std::unique_ptr<PixelSource>(std::move(reader));
}

}  // namespace envconv
