// SPDX-License-Identifier: Apache-2.0
#include "jpeg_damage.h"

#include <jerror.h>
#include <jpeglib.h>

#include <algorithm>
#include <array>
#include <csetjmp>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <memory>
#include <span>
#include <string>

#include "file_bytes.h"

namespace envconv {
namespace {

constexpr JOCTET kEndMark = 0xD9;

// What libjpeg knows of, all of it plain: it is left by longjmp.  The members that are libjpeg's come first, so that
// pointers to them are pointers to the whole.
struct Source {
  jpeg_source_mgr manager;
  int fd;
  std::uint64_t size, position;
  bool unreadable;
  std::array<JOCTET, 65536> buffer;
};

struct Messages {
  jpeg_error_mgr manager;
  std::jmp_buf back;
  std::array<char, JMSG_LENGTH_MAX> text;
};

boolean fill(j_decompress_ptr jpeg) {
  Source& source = *reinterpret_cast<Source*>(jpeg->src);
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
  Source& source = *reinterpret_cast<Source*>(jpeg->src);
  const auto wanted = static_cast<std::size_t>(std::max(count, 0L));
  const std::size_t here = std::min(wanted, source.manager.bytes_in_buffer);
  source.manager.next_input_byte += here;
  source.manager.bytes_in_buffer -= here;
  source.position += wanted - here;
}

[[noreturn]] void give_up(j_common_ptr jpeg) {
  Messages& messages = *reinterpret_cast<Messages*>(jpeg->err);
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

// Steps are 1 or more (ITU-T T.81, B.2.4.1); of 0, nothing would be left.
bool quantisers_make_sense(const jpeg_decompress_struct& jpeg) {
  for (const jpeg_component_info& component :
       std::span(jpeg.comp_info, static_cast<std::size_t>(jpeg.num_components))) {
    const JQUANT_TBL* table = jpeg.quant_tbl_ptrs[component.quant_tbl_no];
    if (table && std::ranges::find(table->quantval, 0) != std::end(table->quantval)) return false;
  }
  return true;
}

// Decodes to an eighth of the size, which spares most of the transform and needs all of the data.
bool decode(jpeg_decompress_struct& jpeg, Source& source, Messages& messages) {
  jpeg.err = jpeg_std_error(&messages.manager);
  messages.manager.error_exit = give_up;
  messages.manager.emit_message = hear;
  if (setjmp(messages.back)) return false;
  jpeg_create_decompress(&jpeg);
  jpeg.src = &source.manager;
  source.manager.init_source = [](j_decompress_ptr) {};
  source.manager.fill_input_buffer = fill;
  source.manager.skip_input_data = skip;
  source.manager.resync_to_restart = jpeg_resync_to_restart;
  source.manager.term_source = [](j_decompress_ptr) {};
  jpeg_read_header(&jpeg, TRUE);
  jpeg.out_color_space = jpeg.jpeg_color_space;
  jpeg.scale_num = 1;
  jpeg.scale_denom = 8;
  jpeg.do_fancy_upsampling = FALSE;
  jpeg_start_decompress(&jpeg);
  if (!quantisers_make_sense(jpeg)) {
    std::strcpy(messages.text.data(), "a quantisation table with zeros");
    return false;
  }
  // libjpeg's own memory, which goes with it.
  JSAMPARRAY row = jpeg.mem->alloc_sarray(reinterpret_cast<j_common_ptr>(&jpeg), JPOOL_IMAGE,
                                          jpeg.output_width * static_cast<JDIMENSION>(jpeg.output_components), 1);
  while (jpeg.output_scanline < jpeg.output_height) jpeg_read_scanlines(&jpeg, row, 1);
  jpeg_finish_decompress(&jpeg);
  return true;
}

}  // namespace

std::string damage_of_jpeg(int fd) {
  const Result<std::uint64_t> size = size_of_file(fd);
  if (!size) return size.error().message;
  const auto source = std::make_unique<Source>();
  source->fd = fd;
  source->size = *size;
  const auto messages = std::make_unique<Messages>();
  jpeg_decompress_struct jpeg{};
  const bool good = decode(jpeg, *source, *messages);
  jpeg_destroy_decompress(&jpeg);
  if (good) return "";
  return source->unreadable ? "cannot be read" : messages->text.data();
}

}  // namespace envconv
