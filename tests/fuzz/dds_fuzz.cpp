// SPDX-License-Identifier: Apache-2.0
#include "dds.h"
#include "decoder_fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  envconv::decode_everything(envconv::open_dds, data, size);
  return 0;
}
