// SPDX-License-Identifier: Apache-2.0
#include "decoder_fuzz.h"
#include "exr.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  envconv::decode_everything(envconv::open_exr, data, size);
  return 0;
}
