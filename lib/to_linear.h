// SPDX-License-Identifier: Apache-2.0
// Elements as a decoder delivers them, made linear, upright pixels.  Internal: not installed.
#pragma once

#include <functional>
#include <vector>

#include "decoder.h"
#include "image.h"

namespace envconv {

/// For the elements of one picture of a file.  Both specs must outlive it.
class ToLinear {
 public:
  /// Whether elements are the pixels, as they are.
  static bool is_identity(const PictureSpec& picture, const FileSpec& spec, bool drop_alpha);

  /// drop_alpha: colour stays as stored, and the image has no alpha channel.
  ToLinear(const PictureSpec& picture, const FileSpec& spec, bool drop_alpha);

  /// `elements`: [count][width][channels] of PictureSpec::element, of the stored rows from `first` on, put where they
  /// are in the upright image.  On the threads of the arena that this is called in.
  void rows(const void* elements, int first, int count, Image& image) const;

 private:
  void row(const void* elements, std::size_t begin, int number, Image& image) const;

  const PictureSpec& picture_;
  const FileSpec& spec_;
  bool drop_alpha_;
  std::function<double(double)> curve_;
  std::vector<float> table_;  ///< of integers, which have few values
  float scale_ = 1;
};

}  // namespace envconv
