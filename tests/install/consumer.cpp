// SPDX-License-Identifier: Apache-2.0
// The library as its users have it: consumer INPUT OUTPUT turns a map into a cube of 32 texels.
#include <envconv.h>

#include <cstdio>

namespace {

envconv::Result<envconv::Ok> run(const char* input, const char* output) {
  using namespace envconv;
  ENVCONV_TRY(PictureFile file, read_pictures(input, {}));
  ENVCONV_TRY(const Recognition source, recognize(file, {}));
  ENVCONV_TRY(const EnvImage image, to_environment(std::move(file), source));
  ResampleOptions options;
  options.layout = find_layout("cube");
  options.height = 32;
  ENVCONV_TRY(EnvImage cube, resample(image, options));
  const Packing& packing = default_packing(*options.layout);
  Picture picture;
  picture.channels = cube.channels;
  ENVCONV_TRY(picture.image, pack(*options.layout, packing, std::move(cube.faces)));
  WriteOptions write;
  write.metadata = metadata_of(*options.layout, packing, all_frames().front(), {});
  std::vector<Picture> pictures;
  pictures.push_back(std::move(picture));
  ENVCONV_CHECK(write_pictures(output, pictures, write));
  return Ok{};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return 2;
  const auto done = run(argv[1], argv[2]);
  if (done) return 0;
  std::fprintf(stderr, "consumer: %s\n", done.error().message.c_str());
  return 1;
}
