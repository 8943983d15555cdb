// SPDX-License-Identifier: Apache-2.0
#include "isolated_messages.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <ctime>

#include "output_file.h"

namespace envconv {

bool send_message(int socket, const std::string& bytes, const std::vector<int>& fds) {
  iovec part{const_cast<char*>(bytes.data()), bytes.size()};
  alignas(cmsghdr) char control[CMSG_SPACE(2 * sizeof(int))] = {};
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  if (!fds.empty()) {
    message.msg_control = control;
    message.msg_controllen = CMSG_SPACE(fds.size() * sizeof(int));
    cmsghdr* header = CMSG_FIRSTHDR(&message);
    header->cmsg_level = SOL_SOCKET;
    header->cmsg_type = SCM_RIGHTS;
    header->cmsg_len = CMSG_LEN(fds.size() * sizeof(int));
    std::memcpy(CMSG_DATA(header), fds.data(), fds.size() * sizeof(int));
  }
  ssize_t sent;
  do {
    sent = ::sendmsg(socket, &message, MSG_NOSIGNAL);
  } while (sent < 0 && errno == EINTR);
  return sent == static_cast<ssize_t>(bytes.size());
}

bool receive_message(int socket, std::string& bytes, std::vector<int>& fds) {
  bytes.resize(kMaxMessage);
  fds.clear();
  iovec part{bytes.data(), bytes.size()};
  alignas(cmsghdr) char control[CMSG_SPACE(4 * sizeof(int))] = {};
  msghdr message{};
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control;
  message.msg_controllen = sizeof control;
  ssize_t got;
  do {
    got = ::recvmsg(socket, &message, MSG_CMSG_CLOEXEC);
  } while (got < 0 && errno == EINTR);
  for (cmsghdr* header = CMSG_FIRSTHDR(&message); got >= 0 && header; header = CMSG_NXTHDR(&message, header)) {
    if (header->cmsg_level != SOL_SOCKET || header->cmsg_type != SCM_RIGHTS) continue;
    const std::size_t count = (header->cmsg_len - CMSG_LEN(0)) / sizeof(int);
    for (std::size_t i = 0; i < count; ++i) {
      int fd;
      std::memcpy(&fd, CMSG_DATA(header) + i * sizeof(int), sizeof fd);
      fds.push_back(fd);
    }
  }
  if (got <= 0 || (message.msg_flags & MSG_TRUNC)) return false;
  bytes.resize(static_cast<std::size_t>(got));
  return true;
}

namespace {

// Seconds.
double time_of(clockid_t clock) {
  timespec now{};
  ::clock_gettime(clock, &now);
  return static_cast<double>(now.tv_sec) + static_cast<double>(now.tv_nsec) * 1e-9;
}

// Seconds that all threads of a process have taken; 0 when it has gone.
double processor_time(pid_t pid) {
  clockid_t clock;
  return ::clock_getcpuclockid(pid, &clock) == 0 ? time_of(clock) : 0;
}

}  // namespace

bool wait_for_message(int socket, pid_t from, double stuck, double seconds) {
  constexpr double kBusy = 10;             // times longer than alone
  constexpr int kSliceMilliseconds = 100;  // what one wait counts as, at most, as this process may be stopped in it
  double waited = 0, idle = 0, used = processor_time(from);
  while (waited < kBusy * seconds && idle < stuck) {
    pollfd polled{socket, POLLIN, 0};
    const double begin = time_of(CLOCK_MONOTONIC);
    const int ready = ::poll(&polled, 1, kSliceMilliseconds);
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return false;
    const double slice = std::min(time_of(CLOCK_MONOTONIC) - begin, kSliceMilliseconds * 1e-3);
    const double now = processor_time(from);
    idle = now > used ? 0 : idle + slice;
    waited += slice;
    used = now;
  }
  return false;
}

std::string pack(const FileSpec& spec) {
  MessageWriter w(MessageKind::spec);
  w.text(spec.compression);
  w.number(static_cast<int>(spec.transfer));
  w.real(spec.gamma);
  w.number(spec.primaries.has_value());
  for (const double v : chromaticity_values(spec.primaries.value_or(Chromaticities{}))) w.real(static_cast<float>(v));
  w.text(spec.color_how);
  w.number(spec.unassociated);
  w.number(spec.orientation);
  w.number(spec.levels);
  w.number(static_cast<std::int64_t>(spec.pictures.size()));
  for (const PictureSpec& picture : spec.pictures) {
    w.text(picture.name);
    w.number(picture.width);
    w.number(picture.height);
    w.number(picture.channels.count());
    for (const std::string& name : picture.channels.names) w.text(name);
    w.number(picture.channels.alpha);
    w.number(static_cast<int>(picture.type));
    w.number(static_cast<int>(picture.element));
    w.number(picture.band);
  }
  w.number(static_cast<std::int64_t>(spec.metadata.size()));
  for (const auto& [name, value] : spec.metadata) {
    w.text(name);
    w.text(value);
  }
  w.number(static_cast<std::int64_t>(spec.warnings.size()));
  for (const std::string& warning : spec.warnings) w.text(warning);
  return w.bytes();
}

// The kind was read already.
bool unpack(MessageReader& r, FileSpec& spec) {
  constexpr std::size_t kText = 4096;
  constexpr std::int64_t kSize = 0x7FFFFFFF;
  spec.compression = printable(r.text(kText));
  spec.transfer = static_cast<Transfer>(r.number(0, 3));
  spec.gamma = r.real();
  if (!(spec.gamma > 0.01f && spec.gamma < 100.f)) spec.gamma = 1;
  const bool has_primaries = r.number(0, 1) != 0;
  std::array<double, 8> chromaticities{};
  for (double& v : chromaticities) v = static_cast<double>(r.real());
  if (has_primaries) spec.primaries = usable_primaries(chromaticities);
  spec.color_how = printable(r.text(kText));
  spec.unassociated = r.number(0, 1) != 0;
  spec.orientation = static_cast<int>(r.number(1, 8));
  spec.levels = static_cast<int>(r.number(1, 64));
  const auto pictures = r.number(1, kMaxPictures);
  for (std::int64_t i = 0; i < pictures && r.good(); ++i) {
    PictureSpec picture;
    picture.name = r.text(kText);
    picture.width = static_cast<int>(r.number(1, kSize));
    picture.height = static_cast<int>(r.number(1, kSize));
    const auto channels = r.number(1, kMaxChannels);
    for (std::int64_t c = 0; c < channels && r.good(); ++c) picture.channels.names.push_back(r.text(kText));
    picture.channels.alpha = static_cast<int>(r.number(-1, channels - 1));
    picture.type = static_cast<PixelType>(r.number(0, static_cast<int>(PixelType::bc6h)));
    picture.element = static_cast<PixelType>(r.number(0, 4));
    picture.band = static_cast<int>(r.number(0, picture.height));
    spec.pictures.push_back(std::move(picture));
  }
  const auto entries = r.number(0, 256);
  for (std::int64_t i = 0; i < entries && r.good(); ++i) {
    const std::string name = r.text(kText);
    spec.metadata[name] = r.text(kMaxMessage);
  }
  const auto warnings = r.number(0, 256);
  for (std::int64_t i = 0; i < warnings && r.good(); ++i) spec.warnings.push_back(printable(r.text(kText)));
  return r.good();
}

MessageWriter failure(const Error& error) {
  MessageWriter w(MessageKind::failure);
  w.number(static_cast<int>(error.code));
  w.text(error.message.substr(0, 2048));
  return w;
}

Error unpack_failure(MessageReader& r) {
  const auto code = r.number(2, 70);
  const std::string text = printable(r.text(4096));
  // A decoder has only these two to say.
  return {code == static_cast<int>(ErrorCode::limit) ? ErrorCode::limit : ErrorCode::input, text};
}

}  // namespace envconv
