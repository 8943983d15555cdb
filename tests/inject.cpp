// SPDX-License-Identifier: Apache-2.0
// Faults on order, for LD_PRELOAD: ENVCONV_INJECT=CALL:N:WHAT[:from] makes the N-th CALL (from 1) fail, or with "from"
// that one and all later ones; with "butK" in its place, those of which K is no divisor.
//
//     CALL  write, fsync, close, rename, open (for writing): of temporaries of ours only; read (pread of inputs,
//           wherever); malloc (and its kin, of the process that was started; not of decoders); allocate
//           (posix_fallocate: scratch storage)
//     WHAT  ENOSPC, EIO ...: errno by number
//
// Allocations count from the first socketpair() on, which is the first thing in main(): what the loader and
// constructors allocate is nobody's to handle.
//
// ENVCONV_INJECT_LOG names a file to which the number of calls is written at the end, so that a test knows how many
// there are to fail.
//
// ENVCONV_INJECT_FOLDS, when it is set, makes the tool find that file systems take upper and lower case for one.
//
// ENVCONV_INJECT_LOCALE, when it is set, has the process begin in the locale of its environment, as a program does that
// uses the library: the tool itself stays in the C locale.
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <clocale>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>

namespace {

enum Call {
  none,
  call_write,
  call_fsync,
  call_close,
  call_rename,
  call_open,
  call_read,
  call_malloc,
  call_allocate,
  calls
};
constexpr const char* names[calls] = {"", "write", "fsync", "close", "rename", "open", "read", "malloc", "allocate"};

int chosen = none;
long first = 0;
int code = 0;
bool from_then_on = false, begun = false;
long spared = 0;  // calls of which this is a divisor succeed
pid_t owner = 0;
std::atomic<long> counted{0};
int log_fd = -1;

__attribute__((constructor)) void set_up() {
  const char* order = getenv("ENVCONV_INJECT");
  const char* log = getenv("ENVCONV_INJECT_LOG");
  char name[16] = "", rest[8] = "";
  if (log) log_fd = open(log, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
  owner = getpid();
  if (getenv("ENVCONV_INJECT_LOCALE") && !setlocale(LC_ALL, "")) abort();  // the test's environment is not as it thinks
  if (!order || sscanf(order, "%15[a-z]:%ld:%d:%7s", name, &first, &code, rest) < 3) return;
  from_then_on = strcmp(rest, "from") == 0 || sscanf(rest, "but%ld", &spared) == 1;
  for (int c = call_write; c < calls; ++c) {
    if (strcmp(name, names[c]) == 0) chosen = c;
  }
}

__attribute__((destructor)) void tell() {
  if (log_fd < 0 || getpid() != owner) return;
  char text[32];
  const int size = snprintf(text, sizeof text, "%ld", counted.load());
  if (write(log_fd, text, static_cast<std::size_t>(size)) != size) _exit(99);
}

// Counts a call of the chosen kind; true when it is to fail.
bool fails(Call call) {
  if (call != chosen) return false;
  const long number = ++counted;
  if (number != first && !(from_then_on && number > first)) return false;
  if (spared > 0 && number % spared == 0) return false;
  errno = code;
  return true;
}

// Descriptors of our temporaries, by number: noted when they are opened, since /proc may not be there to be asked.
std::atomic<bool> ours[4096];

bool is_ours(int fd) { return fd >= 0 && fd < 4096 && ours[fd]; }

int noted(int fd, const char* path) {
  if (fd >= 0 && fd < 4096) ours[fd] = strstr(path, "/.envconv-") != nullptr;
  return fd;
}

bool starves() { return begun && chosen == call_malloc && getpid() == owner && fails(call_malloc); }

}  // namespace

// The function that this one stands before.
#define REAL(name) static const auto real = reinterpret_cast<decltype(&::name)>(dlsym(RTLD_NEXT, #name))

extern "C" {

ssize_t pwrite(int fd, const void* data, size_t size, off_t at) {
  REAL(pwrite);
  if (chosen == call_write && is_ours(fd) && fails(call_write)) return -1;
  return real(fd, data, size, at);
}
ssize_t pwrite64(int fd, const void* data, size_t size, off_t at) { return pwrite(fd, data, size, at); }

int fsync(int fd) {
  REAL(fsync);
  if (chosen == call_fsync && is_ours(fd) && fails(call_fsync)) return -1;
  return real(fd);
}

int close(int fd) {
  REAL(close);
  const bool failing = chosen == call_close && is_ours(fd) && fails(call_close);
  if (fd >= 0 && fd < 4096) ours[fd] = false;
  const int result = real(fd);
  if (failing) errno = code;
  return failing ? -1 : result;
}

int rename(const char* from, const char* to) {
  REAL(rename);
  if (strstr(from, "/.envconv-") && fails(call_rename)) return -1;
  return real(from, to);
}

int open(const char* path, int flags, ...) {
  REAL(open);
  mode_t mode = 0;
  if (flags & (O_CREAT | O_TMPFILE)) {
    va_list arguments;
    va_start(arguments, flags);
    mode = va_arg(arguments, mode_t);
    va_end(arguments);
  }
  if (strstr(path, "/.envconv-") && fails(call_open)) return -1;
  return noted(real(path, flags, mode), path);
}
int open64(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const mode_t mode = va_arg(arguments, mode_t);
  va_end(arguments);
  return open(path, flags, mode);
}

int access(const char* path, int mode) noexcept {
  REAL(access);
  if (strstr(path, "/.ENVCONV-") && getenv("ENVCONV_INJECT_FOLDS")) return 0;
  return real(path, mode);
}

ssize_t pread(int fd, void* data, size_t size, off_t at) {
  REAL(pread);
  if (!is_ours(fd) && fails(call_read)) return -1;
  return real(fd, data, size, at);
}
ssize_t pread64(int fd, void* data, size_t size, off_t at) { return pread(fd, data, size, at); }

int posix_fallocate(int fd, off_t at, off_t size) {
  REAL(posix_fallocate);
  return fails(call_allocate) ? code : real(fd, at, size);
}
int posix_fallocate64(int fd, off_t at, off_t size) { return posix_fallocate(fd, at, size); }

int socketpair(int domain, int type, int protocol, int* sockets) noexcept {
  REAL(socketpair);
  begun = true;
  return real(domain, type, protocol, sockets);
}

// glibc's own names, since dlsym itself allocates.
void* __libc_malloc(size_t);
void* __libc_calloc(size_t, size_t);
void* __libc_realloc(void*, size_t);
void* __libc_memalign(size_t, size_t);

void* malloc(size_t size) { return starves() ? nullptr : __libc_malloc(size); }
void* calloc(size_t count, size_t size) { return starves() ? nullptr : __libc_calloc(count, size); }
void* realloc(void* old, size_t size) { return starves() ? nullptr : __libc_realloc(old, size); }
void* aligned_alloc(size_t alignment, size_t size) { return starves() ? nullptr : __libc_memalign(alignment, size); }

}  // extern "C"
