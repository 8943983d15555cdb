// SPDX-License-Identifier: Apache-2.0
#include "output_file.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <mutex>
#include <set>
#include <vector>

namespace envconv {
namespace {

// Names that a signal handler may have to unlink.  Whoever takes a pointer out of its slot owns the string, so a
// handler and the owner never use the same one.  A process that writes more files at once than there are slots only
// loses this clean-up on a signal.
constexpr int kSlots = 1024;
std::array<std::atomic<char*>, kSlots> temporaries{};
static_assert(std::atomic<char*>::is_always_lock_free);

int register_temporary(const std::string& name) {
  char* copy = ::strdup(name.c_str());
  if (!copy) return -1;
  for (int slot = 0; slot < kSlots; ++slot) {
    char* empty = nullptr;
    if (temporaries[slot].compare_exchange_strong(empty, copy)) return slot;
  }
  std::free(copy);
  return -1;
}

void unregister_temporary(int slot) {
  if (slot >= 0) std::free(temporaries[slot].exchange(nullptr));
}

// A handler must find every temporary: it waits for those that are being made, and none is made any more.
std::atomic<bool> closing{false};
std::atomic<int> being_made{0};

struct Making {
  Making() { ++being_made; }
  ~Making() { --being_made; }
  Making(const Making&) = delete;
  Making& operator=(const Making&) = delete;
};

Error output_error(const std::string& path, const std::string& what, int system = 0) {
  return {ErrorCode::output, printable(path) + ": " + what, system};
}

std::string folder_of(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

std::string random_suffix() {
  std::uint64_t bits = 0;
  if (::getrandom(&bits, sizeof bits, GRND_NONBLOCK) != sizeof bits) {
    static std::atomic<std::uint64_t> counter{0};
    bits = (++counter * 0x9E3779B97F4A7C15u) ^ static_cast<std::uint64_t>(reinterpret_cast<std::uintptr_t>(&bits));
  }
  char text[17];
  std::snprintf(text, sizeof text, "%012llx", static_cast<unsigned long long>(bits & 0xFFFFFFFFFFFFu));
  return text;
}

std::string new_temporary(const std::string& folder) {
  return folder + "/.envconv-" + std::to_string(::getpid()) + "-" + random_suffix() + ".tmp";
}

}  // namespace

// The lock of a process that was killed went with it; its id must be gone as well, since a file is made before it is
// locked.  Done once: a batch should not list a large folder for every file.
void remove_stale_temporaries(const std::string& folder) {
  static std::mutex mutex;
  static std::set<std::string> done;
  {
    const std::lock_guard lock(mutex);
    if (!done.insert(folder).second) return;
  }
  DIR* dir = ::opendir(folder.c_str());
  if (!dir) return;
  while (const dirent* entry = ::readdir(dir)) {
    int pid = 0, end = 0;
    if (std::sscanf(entry->d_name, ".envconv-%d-%*12[0-9a-f].tmp%n", &pid, &end) != 1 || end == 0 ||
        entry->d_name[end] != 0 || pid <= 0 || ::kill(pid, 0) == 0 || errno != ESRCH) {
      continue;
    }
    const int fd = ::openat(::dirfd(dir), entry->d_name, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (fd < 0) continue;
    if (::flock(fd, LOCK_EX | LOCK_NB) == 0) ::unlinkat(::dirfd(dir), entry->d_name, 0);
    ::close(fd);
  }
  ::closedir(dir);
}

void remove_temporaries() noexcept {
  const int saved = errno;
  closing = true;
  // Not for ever: the handler may have interrupted the very thread that is making one, which then never goes on.
  constexpr timespec millisecond{0, 1000000};
  for (int i = 0; i < 100 && being_made != 0; ++i) ::nanosleep(&millisecond, nullptr);
  for (auto& slot : temporaries) {
    // The string is not freed: free() is not async-signal-safe, and the process is about to end.
    if (const char* name = slot.exchange(nullptr)) ::unlink(name);
  }
  errno = saved;
}

std::string printable(const std::string& text) {
  std::string result;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte < 0x20 || byte == 0x7F) {
      char code[5];
      std::snprintf(code, sizeof code, "\\x%02x", byte);
      result += code;
    } else {
      result += c;
    }
  }
  return result;
}

// Where a file system knows no files without a name, one has ours for a moment: the next run clears it away.
int open_nameless(const std::string& folder) {
  int fd = ::open(folder.c_str(), O_TMPFILE | O_RDWR | O_EXCL | O_CLOEXEC, 0600);
  if (fd >= 0 || (errno != EOPNOTSUPP && errno != EISDIR && errno != ENOENT && errno != EINVAL)) return fd;
  const std::string name = new_temporary(folder);
  fd = ::open(name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (fd >= 0) ::unlink(name.c_str());
  return fd;
}

struct OutputFile::State {
  std::string path;       // as given, for messages
  std::string target;     // links resolved
  std::string folder;     // of the target
  std::string temporary;  // in the folder
  int fd = -1;
  int slot = -1;
  int error = 0;  // the first errno
  std::uint64_t position = 0, size = 0;
  // Codecs write many small pieces; they are gathered here.
  std::vector<char> buffer;
  std::uint64_t buffer_position = 0;

  ~State() {
    if (fd >= 0) ::close(fd);
    if (!temporary.empty()) ::unlink(temporary.c_str());
    unregister_temporary(slot);
  }

  void put(const char* data, std::size_t count, std::uint64_t at) {
    while (count > 0 && error == 0) {
      const ssize_t done = ::pwrite(fd, data, count, static_cast<off_t>(at));
      if (done < 0) {
        if (errno != EINTR) error = errno;
      } else if (done == 0) {
        error = EIO;
      } else {
        data += done;
        count -= static_cast<std::size_t>(done);
        at += static_cast<std::uint64_t>(done);
      }
    }
  }

  void flush() {
    if (!buffer.empty()) put(buffer.data(), buffer.size(), buffer_position);
    buffer.clear();
  }

  Error failure(int code) const {
    return output_error(path,
                        std::string(std::strerror(code)) + " while writing " + std::to_string(size) +
                            " bytes (no output was left behind)",
                        code);
  }
};

OutputFile::OutputFile(std::unique_ptr<State> state) : state_(std::move(state)) {}
OutputFile::OutputFile(OutputFile&&) noexcept = default;
OutputFile::~OutputFile() = default;

Result<OutputFile> OutputFile::create(const std::string& path) {
  if (path.empty()) return output_error("\"\"", "an empty name");
  if (path.find('\0') != std::string::npos) return output_error(path, "a name cannot contain a zero byte");
  auto state = std::make_unique<State>();
  state->path = path;
  state->target = path;
  struct stat info {};
  mode_t mode = 0;
  if (::lstat(path.c_str(), &info) == 0) {
    if (S_ISLNK(info.st_mode)) {
      char* resolved = ::realpath(path.c_str(), nullptr);
      if (!resolved) return output_error(path, "a symbolic link that leads nowhere (remove it first)");
      state->target = resolved;
      std::free(resolved);
      if (::stat(path.c_str(), &info) != 0) return output_error(path, std::strerror(errno));
    }
    if (S_ISDIR(info.st_mode)) return output_error(path, "is a directory (give a file name)");
    if (!S_ISREG(info.st_mode)) return output_error(path, "not a regular file (only files can be written)");
    mode = info.st_mode & 07777;
  } else if (errno != ENOENT) {
    return output_error(path, std::strerror(errno));
  }
  state->folder = folder_of(state->target);
  if (::stat(state->folder.c_str(), &info) != 0) {
    if (errno == ENOENT) return output_error(path, "the folder does not exist (make it first)");
    return output_error(path, std::strerror(errno));
  }
  if (!S_ISDIR(info.st_mode)) return output_error(path, "its folder is not a folder");
  if (state->target.back() == '/') return output_error(path, "ends in a slash (give a file name)");
  remove_stale_temporaries(state->folder);
  const Making making;
  if (closing) return output_error(path, "not written, since the process is ending");
  for (int attempt = 0; attempt < 100 && state->fd < 0; ++attempt) {
    std::string name = new_temporary(state->folder);
    // Registered before it exists: a signal between the two finds nothing to remove, never a file it does not know.
    state->slot = register_temporary(name);
    state->fd = ::open(name.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (state->fd >= 0) {
      state->temporary = std::move(name);  // which cannot fail: a file whose name is not kept would stay
      break;
    }
    const int code = errno;
    unregister_temporary(state->slot);
    state->slot = -1;
    if (code != EEXIST)
      return output_error(path, std::string("cannot write into its folder: ") + std::strerror(code), code);
  }
  if (state->fd < 0) return output_error(path, "no free temporary name");
  ::flock(state->fd, LOCK_EX | LOCK_NB);
  if (mode != 0) ::fchmod(state->fd, mode);
  return OutputFile(std::move(state));
}

void OutputFile::write(const void* data, std::size_t count) {
  if (count == 0) return;  // which makes no file longer, wherever the position is
  State& s = *state_;
  constexpr std::size_t kBuffer = std::size_t{1} << 18;
  const std::uint64_t at = s.position;
  s.position += count;
  s.size = std::max(s.size, s.position);
  if (s.error != 0) return;
  if (!s.buffer.empty() && (s.buffer_position + s.buffer.size() != at || s.buffer.size() + count > kBuffer)) s.flush();
  const char* bytes = static_cast<const char*>(data);
  if (count >= kBuffer) {
    s.put(bytes, count, at);
    return;
  }
  if (s.buffer.empty()) s.buffer_position = at;
  s.buffer.insert(s.buffer.end(), bytes, bytes + count);
}

std::size_t OutputFile::read(void* data, std::size_t count) {
  State& s = *state_;
  s.flush();
  std::size_t done = 0;
  while (done < count) {
    const ssize_t n =
        ::pread(s.fd, static_cast<char*>(data) + done, count - done, static_cast<off_t>(s.position + done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) break;
    done += static_cast<std::size_t>(n);
  }
  s.position += done;
  return done;
}

void OutputFile::seek(std::uint64_t position) { state_->position = position; }
std::uint64_t OutputFile::tell() const { return state_->position; }
std::uint64_t OutputFile::size() const { return state_->size; }
const std::string& OutputFile::temporary() const { return state_->temporary; }

Result<Ok> OutputFile::sync() {
  State& s = *state_;
  s.flush();
  if (s.error == 0 && ::fsync(s.fd) != 0 && errno != EINVAL && errno != ENOTSUP) s.error = errno;
  if (s.error != 0) return s.failure(s.error);
  struct stat info {};
  if (::fstat(s.fd, &info) != 0) return s.failure(errno);
  if (static_cast<std::uint64_t>(info.st_size) != s.size) {
    return output_error(s.path, "the disk holds " + std::to_string(info.st_size) + " of " + std::to_string(s.size) +
                                    " bytes (no output was left behind)");
  }
  return Ok{};
}

Result<Ok> OutputFile::commit() {
  State& s = *state_;
  ENVCONV_CHECK(sync());
  const int closed = ::close(s.fd);
  s.fd = -1;
  if (closed != 0 && errno != EINTR) return s.failure(errno);
  if (::rename(s.temporary.c_str(), s.target.c_str()) != 0) {
    const int code = errno;
    return output_error(s.path, std::strerror(code), code);
  }
  s.temporary.clear();
  unregister_temporary(s.slot);
  s.slot = -1;
  // The new name is on the disk only when its folder is.  A failure here leaves a whole file, so it is not reported.
  const int folder = ::open(s.folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder >= 0) {
    ::fsync(folder);
    ::close(folder);
  }
  return Ok{};
}

}  // namespace envconv
