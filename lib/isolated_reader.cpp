// SPDX-License-Identifier: Apache-2.0
//
// Three kinds of process take part:
//   the caller    asks, checks every answer, owns the memory that pixels arrive in;
//   the zygote    forked once, runs one thread of ours (libraries that it loads may start idle ones), forks a child for
//                 each file and reaps it;
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
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <vector>

#include "isolated_child.h"
#include "isolated_memory.h"
#include "isolated_messages.h"
#include "isolated_zygote.h"

namespace envconv {
namespace {

constexpr int kStuckSeconds = 20;  // without any processor time

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

  Result<Ok> open(const std::string& format, int fd, DecoderOptions options) {
    MessageReader reply("");
    MessageKind kind = MessageKind::death;
    ENVCONV_CHECK(ask_child(format, fd, options, kind, reply));
    if (kind == MessageKind::library && !options.library) {
      // Another child, as the library is loaded before children are forked: once for all of them.
      options.library = true;
      ENVCONV_CHECK(ask_child(format, fd, options, kind, reply));
    }
    if (kind != MessageKind::spec || !unpack(reply, spec_)) return senseless();
    theirs_ = spec_;
    // What the child decodes whole can be taken in bands all the same.
    for (PictureSpec& picture : spec_.pictures) {
      if (picture.band == 0) picture.band = band_rows(picture, 1);
    }
    return Ok{};
  }

  const FileSpec& spec() const override { return spec_; }

  bool in_bands() const override {
    return std::ranges::any_of(theirs_.pictures, [](const PictureSpec& picture) { return picture.band > 0; });
  }

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

  // Has a child forked for the file, and waits for what it says of it.
  Result<Ok> ask_child(const std::string& format, int fd, const DecoderOptions& options, MessageKind& kind,
                       MessageReader& reply) {
    MessageWriter request(MessageKind::request);
    request.text(format);
    request.number(options.max_pixels);
    request.number(options.threads);
    request.number(options.level);
    request.number(options.library);
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
      child_ = ask_zygote(request.bytes(), fd, sockets[1]);  // until it has one, which is after the library was loaded
      ::close(sockets[1]);
      if (socket_ >= 0) ::close(socket_);
      socket_ = sockets[0];
      if (child_ < 0) continue;
      auto got = receive(kOpenSeconds, kind, reply);
      if (got && kind == MessageKind::started) {
        child_ = static_cast<pid_t>(reply.number(1, INT32_MAX));
        got = receive(kOpenSeconds, kind, reply);
      }
      if (got) return Ok{};
      error = got.error();
      // No word at all, not even of a death: the zygote is gone.
      if (!silent_) return error;
      forget_zygote();
    }
    return error;
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
    const PicturesPlan plan = plan_of(spec_);
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
    const SharedWindow window(theirs_);
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
  std::optional<SharedWindow> window_;
  MappedMemory shared_;     // the window
  std::int64_t turn_ = -1;  // of the band that was asked for last
  Band asked_, ready_;
  char* ready_place_ = nullptr;
  std::size_t forgotten_ = 0;  // bytes of the ready band that are not mapped any more
};

}  // namespace

Result<std::unique_ptr<PixelSource>> open_isolated(const std::string& format, int fd, const DecoderOptions& options) {
  auto reader = std::make_unique<IsolatedReader>();
  ENVCONV_CHECK(reader->open(format, fd, options));
  return std::unique_ptr<PixelSource>(std::move(reader));
}

}  // namespace envconv
