// SPDX-License-Identifier: Apache-2.0
#include "jpeg_damage.h"

#include <memory>
#include <string>

#include "file_bytes.h"
#include "jpeg_source.h"

namespace envconv {
namespace {

// Decodes to an eighth of the size, which spares most of the transform and needs all of the data.
bool decode(JpegInput& input, int fd, std::uint64_t size) {
  if (setjmp(input.messages.back)) return false;
  create_jpeg(input, fd, size);
  jpeg_decompress_struct& jpeg = input.jpeg;
  jpeg_read_header(&jpeg, TRUE);
  jpeg.out_color_space = jpeg.jpeg_color_space;
  jpeg.scale_num = 1;
  jpeg.scale_denom = 8;
  jpeg.do_fancy_upsampling = FALSE;
  jpeg_start_decompress(&jpeg);
  if (!quantisers_make_sense(input)) return false;
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
  const auto input = std::make_unique<JpegInput>();  // zeros
  const bool good = decode(*input, fd, *size);
  jpeg_destroy_decompress(&input->jpeg);
  return good ? "" : input->damage();
}

}  // namespace envconv
