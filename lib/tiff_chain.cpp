// SPDX-License-Identifier: Apache-2.0
// TIFF Revision 6.0, section 2 (Adobe 1992), and the BigTIFF design, which has the same structures with 64-bit counts
// and offsets.
#include "tiff_chain.h"

#include <algorithm>
#include <optional>

#include "texture_file.h"

namespace envconv {
namespace {

constexpr std::uint16_t new_subfile_type = 254, strip_offsets = 273, tile_offsets = 324;
constexpr std::uint16_t type_long = 4, type_long8 = 16;
constexpr std::uint64_t header_room = 8;  // of a file with 32-bit offsets

// Bytes of a value, or 0.
std::size_t size_of_type(std::uint16_t type) {
  constexpr std::uint8_t sizes[] = {0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4, 0, 0, 8, 8, 8};
  return type < std::size(sizes) ? sizes[type] : 0;
}

// What differs between the two kinds of file.
struct Form {
  std::size_t count_size;  // of a directory's number of entries
  std::size_t entry_size;
  std::size_t word_size;  // of an offset, a value's count and the value itself
};
constexpr Form form_of(bool big) { return big ? Form{8, 20, 8} : Form{2, 12, 4}; }

void put(ByteWriter& out, std::uint64_t value, std::size_t size) {
  for (std::size_t i = 0; i < size; ++i) {
    const char byte = static_cast<char>(value >> (8 * i) & 0xFF);
    out.text({&byte, 1});
  }
}

std::uint64_t get(const std::uint8_t* bytes, std::size_t size) {
  std::uint64_t value = 0;
  for (std::size_t i = size; i-- > 0;) value = value << 8 | bytes[i];
  return value;
}

std::optional<std::vector<std::uint8_t>> bytes_at(OutputFile& file, std::uint64_t at, std::uint64_t size) {
  if (at > file.size() || size > file.size() - at) return {};
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size));
  file.seek(at);
  if (file.read(bytes.data(), bytes.size()) != bytes.size()) return {};
  return bytes;
}

Error strange() { return {ErrorCode::output, "the image library wrote no TIFF file of one picture"}; }

bool holds_offsets(std::uint16_t tag) { return tag == strip_offsets || tag == tile_offsets; }

}  // namespace

TiffChain::TiffChain(OutputFile& file) : file_(file) {}

std::uint64_t TiffChain::begin() {
  // A part's own header is of no use afterwards: that of the first makes room for a longer one.
  file_.seek(std::max(file_.size(), header_room));
  pad_file(file_, 8);
  return base_ = file_.tell();
}

Result<TiffChain::Entry> TiffChain::read_entry(const std::uint8_t* bytes, bool big) const {
  const Form form = form_of(big);
  Entry entry;
  entry.tag = static_cast<std::uint16_t>(get(bytes, 2));
  entry.type = static_cast<std::uint16_t>(get(bytes + 2, 2));
  entry.count = get(bytes + 4, form.word_size);
  const std::uint8_t* word = bytes + 4 + form.word_size;
  const std::size_t each = size_of_type(entry.type);
  if (each == 0 || entry.count > file_.size()) return strange();
  const std::uint64_t size = entry.count * each;
  if (size <= form.word_size) {
    entry.value.assign(word, word + size);
    return entry;
  }
  auto value = bytes_at(file_, base_ + get(word, form.word_size), size);
  if (!value) return strange();
  entry.value = std::move(*value);
  return entry;
}

Result<TiffChain::Directory> TiffChain::read_directory() const {
  const auto header = bytes_at(file_, base_, 16);
  if (!header || (*header)[0] != 'I' || (*header)[1] != 'I') return strange();
  const bool big = get(header->data() + 2, 2) == 43;
  const Form form = form_of(big);
  const std::uint64_t at = base_ + get(header->data() + form.word_size, form.word_size);
  const auto count_bytes = bytes_at(file_, at, form.count_size);
  if (!count_bytes) return strange();
  const std::uint64_t count = get(count_bytes->data(), form.count_size);
  if (count == 0 || count > 0xFFFF) return strange();
  const auto table = bytes_at(file_, at + form.count_size, count * form.entry_size + form.word_size);
  if (!table || get(table->data() + count * form.entry_size, form.word_size) != 0) return strange();
  Directory directory;
  for (std::uint64_t i = 0; i < count; ++i) {
    ENVCONV_TRY(Entry entry, read_entry(table->data() + i * form.entry_size, big));
    if (holds_offsets(entry.tag)) {
      // In the widest form, until it is known what the file needs.
      const std::size_t each = size_of_type(entry.type);
      ByteWriter wide;
      for (std::uint64_t k = 0; k < entry.count; ++k) put(wide, base_ + get(entry.value.data() + k * each, each), 8);
      entry.value.assign(wide.bytes().begin(), wide.bytes().end());
      entry.type = type_long8;
    }
    directory.push_back(std::move(entry));
  }
  return directory;
}

// A disk that is full has not got what was written, and says so itself when asked to sync.
Result<Ok> TiffChain::unless_disk_failed(Error error) {
  if (!file_.sync()) return Ok{};
  return error;
}

Result<Ok> TiffChain::end() {
  auto directory = read_directory();
  if (!directory) return unless_disk_failed(directory.error());
  if (!directories_.empty()) {
    std::erase_if(*directory, [](const Entry& entry) { return entry.tag == new_subfile_type; });
    directory->insert(directory->begin(), {new_subfile_type, type_long, 1, {1, 0, 0, 0}});
  }
  directories_.push_back(std::move(*directory));
  return Ok{};
}

// Entries and what does not fit into them: an even number of bytes.
std::uint64_t TiffChain::directory_size(const Directory& directory, bool big) const {
  const Form form = form_of(big);
  std::uint64_t size = form.count_size + directory.size() * form.entry_size + form.word_size;
  for (const Entry& entry : directory) {
    const std::uint64_t bytes = entry.value.size() / (!big && holds_offsets(entry.tag) ? 2 : 1);
    if (bytes > form.word_size) size += bytes + bytes % 2;
  }
  return size;
}

// At the file's end, an even offset.
void TiffChain::write_directory(const Directory& directory, bool big, bool last) {
  const Form form = form_of(big);
  const std::uint64_t start = file_.tell(), next = start + directory_size(directory, big);
  const std::uint64_t beside = start + form.count_size + directory.size() * form.entry_size + form.word_size;
  ByteWriter table, values;
  put(table, directory.size(), form.count_size);
  for (const Entry& entry : directory) {
    const bool narrow = !big && holds_offsets(entry.tag);
    ByteWriter value;
    if (narrow) {
      for (std::uint64_t k = 0; k < entry.count; ++k) put(value, get(entry.value.data() + k * 8, 8), 4);
    } else {
      for (const std::uint8_t byte : entry.value) put(value, byte, 1);
    }
    put(table, entry.tag, 2);
    put(table, narrow ? type_long : entry.type, 2);
    put(table, entry.count, form.word_size);
    if (value.size() <= form.word_size) {
      value.zeros(form.word_size - value.size());
      table.text(value.bytes());
      continue;
    }
    put(table, beside + values.size(), form.word_size);
    values.text(value.bytes());
    values.align(2);
  }
  put(table, last ? 0 : next, form.word_size);
  file_.write(table.bytes().data(), table.size());
  file_.write(values.bytes().data(), values.size());
}

Result<Ok> TiffChain::finish(std::uint64_t largest) {
  if (directories_.empty()) return unless_disk_failed(strange());
  file_.seek(file_.size());
  pad_file(file_, 8);
  const std::uint64_t first = file_.tell();
  std::uint64_t end = first;
  for (const Directory& directory : directories_) end += directory_size(directory, true);
  const bool big = end > largest;
  for (std::size_t i = 0; i < directories_.size(); ++i)
    write_directory(directories_[i], big, i + 1 == directories_.size());
  ByteWriter header;
  header.text("II");
  put(header, big ? 43 : 42, 2);
  if (big) put(header, 8, 4);  // bytes of an offset, and two that are zero
  put(header, first, form_of(big).word_size);
  file_.seek(0);
  file_.write(header.bytes().data(), header.size());
  return Ok{};
}

}  // namespace envconv
