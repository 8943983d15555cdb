// SPDX-License-Identifier: Apache-2.0
// What is the same in OpenEXR files whoever packs their pixels, we or OpenEXR.  Internal: not installed.
#pragma once

#include <ImfIO.h>
#include <ImfPixelType.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "exr_shared.h"
#include "io.h"
#include "output_file.h"

namespace envconv {

/// A file as OpenEXR writes to it.
class ExrOutput final : public Imf::OStream {
 public:
  explicit ExrOutput(OutputFile& file) : OStream(kStreamName), file_(file) {}
  void write(const char c[], int n) override { file_.write(c, static_cast<std::size_t>(std::max(n, 0))); }
  std::uint64_t tellp() override { return file_.tell(); }
  void seekp(std::uint64_t position) override { file_.seek(position); }

 private:
  OutputFile& file_;
};

/// Values that the type cannot hold, counted by any thread.
struct ExrCounts {
  std::atomic<std::int64_t> high{0}, negative{0}, nonfinite{0};
  void add_to(WriteReport& report) const;
};

/// Bytes of a value.
inline std::size_t size_of(Imf::PixelType type) { return type == Imf::HALF ? 2 : 4; }

/// Values as the file has them; floats are only counted, and `to` may be null.
void convert_values(const float* from, std::size_t count, Imf::PixelType type, void* to, ExrCounts& counts);

}  // namespace envconv
