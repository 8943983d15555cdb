// SPDX-License-Identifier: Apache-2.0
// What the processes that isolated_reader.cpp names say to each other.  Internal: not installed.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "decoder.h"
#include "result.h"

namespace envconv {

constexpr std::size_t kMaxMessage = 128 * 1024;  ///< bytes; below the usual limit of a socket's buffer

/// How a message begins.
enum class MessageKind : std::uint32_t { request, started, spec, library, failure, go, window, rows, done, death };
constexpr std::int64_t kMessageKinds = 10;

/// A message, item by item.
class MessageWriter {
 public:
  explicit MessageWriter(MessageKind kind) { number(static_cast<std::int64_t>(kind)); }
  void number(std::int64_t v) { bytes_.append(reinterpret_cast<const char*>(&v), sizeof v); }
  void real(float v) { bytes_.append(reinterpret_cast<const char*>(&v), sizeof v); }
  void text(const std::string& v) {
    number(static_cast<std::int64_t>(v.size()));
    bytes_ += v;
  }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

/// Reads what another process wrote, which may be anything: a missing or senseless item makes good() false for ever.
class MessageReader {
 public:
  explicit MessageReader(std::string bytes) : bytes_(std::move(bytes)) {}
  std::int64_t number(std::int64_t low, std::int64_t high) {
    std::int64_t v = low;
    take(&v, sizeof v);
    if (v < low || v > high) good_ = false;
    return good_ ? v : low;
  }
  float real() {
    float v = 0;
    take(&v, sizeof v);
    return v;
  }
  std::string text(std::size_t limit) {
    const auto size = static_cast<std::size_t>(number(0, static_cast<std::int64_t>(limit)));
    if (!good_ || size > bytes_.size() - at_) {
      good_ = false;
      return {};
    }
    at_ += size;
    return bytes_.substr(at_ - size, size);
  }
  bool good() const { return good_; }

 private:
  void take(void* to, std::size_t size) {
    if (!good_ || size > bytes_.size() - at_) {
      good_ = false;
      return;
    }
    std::memcpy(to, bytes_.data() + at_, size);
    at_ += size;
  }
  std::string bytes_;
  std::size_t at_ = 0;
  bool good_ = true;
};

/// False when the message did not leave as a whole.
bool send_message(int socket, const std::string& bytes, const std::vector<int>& fds = {});
/// False at the end, or on an error.  Descriptors that came along are the caller's.
bool receive_message(int socket, std::string& bytes, std::vector<int>& fds);

/// Waits for a message from a process, a child of any generation.  False when that one hangs: it takes no processor
/// time for `stuck` seconds, or work that needs `seconds` of it is not done in the time that a busy machine could take.
/// Time in which this process is stopped does not count.
bool wait_for_message(int socket, pid_t from, double stuck, double seconds);

/// A message of MessageKind::spec.
std::string pack(const FileSpec& spec);
/// What a child says of a file, once the kind was read; false when it makes no sense.
bool unpack(MessageReader& r, FileSpec& spec);

/// A message of MessageKind::failure.
MessageWriter failure(const Error& error);
Error unpack_failure(MessageReader& r);

}  // namespace envconv
