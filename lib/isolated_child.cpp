// SPDX-License-Identifier: Apache-2.0
#include "isolated_child.h"

#include <malloc.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <new>
#include <vector>

#include "isolated_memory.h"
#include "isolated_messages.h"

namespace envconv {

int decode_seconds(const FileSpec& spec) {
  double values = 0;
  for (const PictureSpec& picture : spec.pictures) {
    values += static_cast<double>(picture.width) * picture.height * picture.channels.count();
  }
  return static_cast<int>(std::min(20 + values / 500e3, 86400.));
}

namespace {

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
  const PicturesPlan plan = plan_of(spec);
  const ChildsMemory memory(shared, plan.bytes, spec, base, threads);
  for (std::size_t i = 0; i < spec.pictures.size(); ++i)
    ENVCONV_CHECK(decoder.decode(static_cast<int>(i), memory.at(plan.offsets[i])));
  return Ok{};
}

// Decodes the rows that the caller asks for, and says so each time, until it has enough.
Result<Ok> decode_rows_for_caller(int socket, int shared, Decoder& decoder, std::uint64_t base, int threads) {
  const FileSpec& spec = decoder.spec();
  const SharedWindow window(spec);
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

}  // namespace

void run_child(int socket, int file, const std::string& format, const DecoderOptions& options,
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
    if (!*decoder) finish(MessageWriter(MessageKind::library).bytes());
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

}  // namespace envconv
