// SPDX-License-Identifier: Apache-2.0
#include "jpeg_source.h"

#include <algorithm>
#include <cstring>
#include <iterator>
#include <span>

#include "file_bytes.h"

namespace envconv {
namespace {

constexpr JOCTET kEndMark = 0xD9;

boolean fill(j_decompress_ptr jpeg) {
  auto& source = *reinterpret_cast<JpegInput::Source*>(jpeg->src);
  auto count = static_cast<std::size_t>(
      std::min<std::uint64_t>(source.buffer.size(), source.size - std::min(source.position, source.size)));
  if (count > 0 && !read_at(source.fd, source.position, std::span(source.buffer).first(count))) {
    source.unreadable = true;
    count = 0;
  }
  if (count == 0) WARNMS(jpeg, JWRN_JPEG_EOF);  // does not return
  source.position += count;
  source.manager.next_input_byte = source.buffer.data();
  source.manager.bytes_in_buffer = count;
  return TRUE;
}

void skip(j_decompress_ptr jpeg, long count) {
  auto& source = *reinterpret_cast<JpegInput::Source*>(jpeg->src);
  const auto wanted = static_cast<std::size_t>(std::max(count, 0L));
  const std::size_t here = std::min(wanted, source.manager.bytes_in_buffer);
  source.manager.next_input_byte += here;
  source.manager.bytes_in_buffer -= here;
  source.position += wanted - here;
}

[[noreturn]] void give_up(j_common_ptr jpeg) {
  auto& messages = *reinterpret_cast<JpegInput::Messages*>(jpeg->err);
  messages.manager.format_message(jpeg, messages.text.data());
  std::longjmp(messages.back, 1);
}

// Warnings have negative levels.
void hear(j_common_ptr jpeg, int level) {
  if (level >= 0) return;
  const jpeg_error_mgr& told = *jpeg->err;
  switch (told.msg_code) {
    case JWRN_JFIF_MAJOR:
    case JWRN_ADOBE_XFORM: return;  // guesses at what metadata mean
    case JWRN_EXTRANEOUS_DATA: {
      // Some cameras leave a few bytes before the end mark.
      constexpr int few = 4;
      if (told.msg_parm.i[0] <= few && told.msg_parm.i[1] == kEndMark) return;
      break;
    }
    default: break;
  }
  give_up(jpeg);
}

}  // namespace

bool quantisers_make_sense(JpegInput& input) {
  for (const jpeg_component_info& component :
       std::span(input.jpeg.comp_info, static_cast<std::size_t>(input.jpeg.num_components))) {
    const JQUANT_TBL* table = input.jpeg.quant_tbl_ptrs[component.quant_tbl_no];
    if (!table || std::ranges::find(table->quantval, 0) == std::end(table->quantval)) continue;
    std::strcpy(input.messages.text.data(), "a quantisation table with zeros");
    return false;
  }
  return true;
}

void create_jpeg(JpegInput& input, int fd, std::uint64_t size) {
  input.jpeg.err = jpeg_std_error(&input.messages.manager);
  input.messages.manager.error_exit = give_up;
  input.messages.manager.emit_message = hear;
  jpeg_create_decompress(&input.jpeg);
  input.source.fd = fd;
  input.source.size = size;
  jpeg_source_mgr& manager = input.source.manager;
  input.jpeg.src = &manager;
  manager.init_source = [](j_decompress_ptr) {};
  manager.fill_input_buffer = fill;
  manager.skip_input_data = skip;
  manager.resync_to_restart = jpeg_resync_to_restart;
  manager.term_source = [](j_decompress_ptr) {};
}

}  // namespace envconv
