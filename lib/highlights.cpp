// SPDX-License-Identifier: Apache-2.0
// Highlights of a Source: split from the rest, spread where texels are slivers, repeated across seams, and scaled so
// that outputs receive exactly their energy.
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <tuple>

#include "assertion.h"
#include "solid_angle.h"
#include "source.h"

namespace envconv {
namespace {

// A texel is a highlight above so many times the image's mean, the mean itself taken of values cut off there.
constexpr double threshold_over_mean = 4.0;
// At most one texel in so many may be a highlight: beyond that the threshold goes up.
constexpr double most_texels = 1.0 / 8;
// Slivers (at a pole of latlong, say): side ratio above which a highlight is spread along its short side.
constexpr double sliver_ratio = 2.0;
constexpr int longest_spread = 64;  // texels

// Threshold from a histogram of a sample of texels: 4 bins an octave, each with the sum of its values.
struct Histogram {
  static constexpr std::size_t bins = 1024;
  std::array<double, bins> count{}, sum{};
  // A float's exponent and the first two bits of its mantissa.  Infinity, which a file may hold, has a bin as well.
  void add(float v) {
    const float value = v > 0 ? v : 0;
    const std::uint32_t bin = std::bit_cast<std::uint32_t>(value) >> 21;
    count[bin] += 1;
    sum[bin] += static_cast<double>(value);
  }
  double mean_below(double limit) const {
    double n = 0, s = 0;
    for (std::size_t b = 0; b < bins; ++b) {
      if (count[b] == 0) continue;
      n += count[b];
      s += std::min(sum[b], count[b] * limit);
    }
    return n > 0 ? s / n : 0;
  }
  double share_above(double limit) const {
    double n = 0, above = 0;
    for (std::size_t b = 0; b < bins; ++b) {
      n += count[b];
      if (count[b] > 0 && sum[b] / count[b] > limit) above += count[b];
    }
    return n > 0 ? above / n : 0;
  }
};

}  // namespace

Highlights::Block* Source::block_at(int face, int x, int y, bool create) {
  const SourceFace& s = faces_[static_cast<std::size_t>(face)];
  ENVCONV_ASSERT(x >= 0 && x < s.columns && y >= 0 && y < s.rows);
  constexpr int side = Highlights::side;
  std::int32_t& index = highlights_.index[static_cast<std::size_t>(s.first_block + y / side * s.blocks + x / side)];
  if (index < 0) {
    if (!create) return nullptr;
    index = static_cast<std::int32_t>(highlights_.blocks.size());
    highlights_.blocks.emplace_back();
  }
  return &highlights_.blocks[static_cast<std::size_t>(index)];
}

Highlights::Texel* Source::highlight_at(int face, int x, int y) {
  Highlights::Block* block = block_at(face, x, y, false);
  return block ? block->find(Highlights::place(x, y)) : nullptr;
}

Highlights::Texel& Highlights::Block::add(int place) {
  constexpr std::size_t step = 16;  // of what is reserved
  if (Texel* texel = find(place)) return *texel;
  if (texels_.size() == texels_.capacity()) texels_.reserve(texels_.size() + step);
  number_[place] = static_cast<std::uint8_t>(texels_.size());
  here_.add(place);
  return texels_.emplace_back();
}

void Source::split_highlights(const EnvImage& image) {
  const auto brightness = [](const float* t) { return std::max({std::abs(t[0]), std::abs(t[1]), std::abs(t[2])}); };
  const bool whole = layout_->info().domain == Domain::square;
  // Of a face's own texels; what stands in others says nothing (a photograph of a mirror ball has a room around it).
  const auto owned = [&](int f, int x, int y) {
    if (whole) return true;
    const Size size = faces_[static_cast<std::size_t>(f)].size;
    return layout_->owns(f, u_from_texel(x - apron_, size.width, placement_),
                         u_from_texel(y - apron_, size.height, placement_));
  };
  Histogram histogram;
  std::size_t total = 0;
  for (const SourceFace& s : faces_)
    total += static_cast<std::size_t>(s.size.width) * static_cast<std::size_t>(s.size.height);
  const double sampled = whole ? 250000 : 60000;  // who owns a texel takes longer to say
  const int step = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(total) / sampled)));
  for (int f = 0; f < layout_->face_count(); ++f) {
    const SourceFace& s = faces_[static_cast<std::size_t>(f)];
    for (int y = apron_; y < apron_ + s.size.height; y += step) {
      // A texel here and there maps pages all around.
      s.image->relieve();
      for (int x = apron_ + (y - apron_) / step % step; x < apron_ + s.size.width; x += step)
        if (owned(f, x, y)) histogram.add(brightness(pixel(s, x, y)));
    }
  }
  double limit = threshold_over_mean * histogram.mean_below(1e30);
  for (int i = 0; i < 40; ++i) limit = threshold_over_mean * histogram.mean_below(limit);
  while (limit > 0 && histogram.share_above(limit) > most_texels) limit *= 1.5;
  threshold_ = limit > 0 ? static_cast<float>(limit) : std::numeric_limits<float>::max();

  struct Found {
    std::int32_t x, y;
    float base[3];
  };
  std::fill_n(lowest_, 4, std::numeric_limits<float>::max());
  const std::vector<RectangleRange> ranges = survey(image);
  std::vector<std::vector<Found>> found_in(ranges.size());
  tbb::parallel_for(std::size_t{0}, ranges.size(), [&](std::size_t i) {
    const RectangleRange& r = ranges[i];
    if (r.brightest <= threshold_) return;
    const SourceFace& s = faces_[static_cast<std::size_t>(r.face)];
    s.image->relieve();
    for (int y = apron_ + r.y; y < apron_ + r.y + r.height; ++y)
      for (int x = apron_ + r.x; x < apron_ + r.x + r.width; ++x) {
        const float* t = pixel(s, x, y);
        if (brightness(t) <= threshold_ || !owned(r.face, x, y)) continue;
        // What lies below the highlight: the mean of the texels around it that are none, so that the kernel has no step
        // to ring at; deep inside a bright area, the threshold.
        Found hit{x, y, {}};
        double sum[3]{}, n = 0;
        for (int yy = std::max(y - 2, apron_); yy <= std::min(y + 2, apron_ + s.size.height - 1); ++yy)
          for (int xx = std::max(x - 2, apron_); xx <= std::min(x + 2, apron_ + s.size.width - 1); ++xx) {
            const float* q = pixel(s, xx, yy);
            if (brightness(q) > threshold_ || !owned(r.face, xx, yy)) continue;
            for (int c = 0; c < 3; ++c) sum[c] += static_cast<double>(q[c]);
            n += 1;
          }
        for (int c = 0; c < 3; ++c) hit.base[c] = std::min(t[c], n > 0 ? static_cast<float>(sum[c] / n) : threshold_);
        found_in[i].push_back(hit);
      }
  });
  for (const RectangleRange& r : ranges)
    for (std::size_t c = 0; c < 4; ++c) lowest_[c] = std::min(lowest_[c], r.low[c]);
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    const int face = ranges[i].face;
    for (const Found& h : found_in[i]) {
      const float* t = pixel(faces_[static_cast<std::size_t>(face)], h.x, h.y);
      Highlights::Block& block = *block_at(face, h.x, h.y, true);
      const int k = Highlights::place(h.x, h.y);
      block.split.add(k);
      Highlights::Texel& texel = block.add(k);
      std::copy_n(h.base, 3, texel.base);
      for (int c = 0; c < 3; ++c) texel.excess[c] = t[c] - h.base[c];
    }
    found_in[i] = {};
  }
}

namespace {

// Solid angles of single texels, computed for blocks of them; a few blocks are remembered.
class SolidAngles {
 public:
  SolidAngles(const Layout& layout, Placement placement, const std::vector<SourceFace>& faces)
      : layout_(layout), placement_(placement), faces_(faces), blocks_(remembered) {}

  double at(int face, int x, int y) {
    const int left = x / side * side, top = y / side * side;
    Block& block = blocks_[static_cast<std::size_t>((x / side * 5 + y / side * 3 + face) % remembered)];
    const Size size = faces_[static_cast<std::size_t>(face)].size;
    const int width = std::min(side, size.width - left);
    if (block.face != face || block.x != left || block.y != top) {
      block.face = face, block.x = left, block.y = top;
      texel_solid_angles(layout_, face, size, placement_, left, top, width, std::min(side, size.height - top),
                         block.omega);
    }
    return block.omega[(y - top) * width + (x - left)];
  }

 private:
  static constexpr int side = solid_angle_block, remembered = 8;
  struct Block {
    int face = -1, x = 0, y = 0;
    double omega[side * side];
  };
  const Layout& layout_;
  Placement placement_;
  const std::vector<SourceFace>& faces_;
  std::vector<Block> blocks_;
};

}  // namespace

void Source::spread_highlights() {
  struct Deposit {
    std::int32_t face, x, y;
    std::array<float, 3> excess;
    double thin, wide;  // of the texel that it comes from, in radians
    auto place() const { return std::tuple(face, y, x); }
  };
  constexpr int side = Highlights::side;
  // A texel's centre, the short one of its principal directions on the sphere, and both sides' angles.
  const auto sides = [&](int face, double x, double y, Vec3& d, Vec3& thin, double& wide_angle, double& thin_angle) {
    const SourceFace& s = faces_[static_cast<std::size_t>(face)];
    const DirectionJet jet = layout_->direction_jet(face, u_from_texel(x - apron_, s.size.width, placement_),
                                                    u_from_texel(y - apron_, s.size.height, placement_));
    const Vec3 a = texel_extent(s.size.width, placement_) * jet.du,
               b = texel_extent(s.size.height, placement_) * jet.dv;
    const double aa = dot(a, a), ab = dot(a, b), bb = dot(b, b);
    const double root = std::sqrt((aa - bb) * (aa - bb) + 4 * ab * ab);
    const double angle = 0.5 * std::atan2(2 * ab, aa - bb);
    wide_angle = std::sqrt(0.5 * (aa + bb + root));
    thin_angle = std::sqrt(std::max(0.0, 0.5 * (aa + bb - root)));
    d = jet.d;
    thin = cross(jet.d, std::cos(angle) * a + std::sin(angle) * b);
    const double n = length(thin);
    if (n > 0) thin = (1 / n) * thin;
    return std::isfinite(n) && n > 0 && thin_angle > 1e-6 * wide_angle;
  };
  struct Place {
    int face, x, y;  // of a block's first padded texel
  };
  std::vector<Place> blocks;
  for (int f = 0; f < layout_->face_count(); ++f) {
    const SourceFace& s = faces_[static_cast<std::size_t>(f)];
    for (int y = 0; y < s.rows; y += side)
      for (int x = 0; x < s.columns; x += side)
        if (block_at(f, x, y, false)) blocks.push_back({f, x, y});
  }
  const auto spread = [&](const Place& block, SolidAngles& solid_angles, std::vector<Deposit>& out) {
    const int f = block.face;
    const SourceFace& s = faces_[static_cast<std::size_t>(f)];
    for (int y = block.y; y < block.y + side; ++y)
      for (int x = block.x; x < block.x + side; ++x) {
        if (!in_face(s, x, y)) continue;
        Highlights::Texel* texel = highlight_at(f, x, y);
        if (!texel || !texel->lit()) continue;
        float* e = texel->excess;
        Vec3 d, thin;
        double wide_angle, thin_angle;
        // Centred on a singular point (a pole), a texel has no sides there; a quarter of it further in it has.
        if (!sides(f, x, y, d, thin, wide_angle, thin_angle)) {
          const double in_x = x - apron_ < s.size.width / 2 ? 0.25 : -0.25;
          const double in_y = y - apron_ < s.size.height / 2 ? 0.25 : -0.25;
          if (!sides(f, x + in_x, y + in_y, d, thin, wide_angle, thin_angle)) continue;
        }
        if (wide_angle <= sliver_ratio * thin_angle) continue;
        const int n = static_cast<int>(std::min<double>(longest_spread, wide_angle / thin_angle));
        const double omega = solid_angles.at(f, x - apron_, y - apron_);
        const std::size_t before = out.size();
        for (int k = 0; k < n; ++k) {
          const double t = (k - 0.5 * (n - 1)) * thin_angle;
          const Location at = layout_->locate(std::cos(t) * d + std::sin(t) * thin);
          const SourceFace& o = faces_[static_cast<std::size_t>(at.face)];
          const int i = std::clamp(static_cast<int>(std::lround(texel_from_u(at.u, o.size.width, placement_))), 0,
                                   o.size.width - 1);
          const int j = std::clamp(static_cast<int>(std::lround(texel_from_u(at.v, o.size.height, placement_))), 0,
                                   o.size.height - 1);
          const double to = solid_angles.at(at.face, i, j);
          if (!(to > 0)) continue;
          const float share = static_cast<float>(omega / (n * to));
          out.push_back(
              {at.face, i + apron_, j + apron_, {share * e[0], share * e[1], share * e[2]}, thin_angle, wide_angle});
        }
        if (out.size() > before) std::fill_n(e, 3, 0.0f);
      }
  };
  // Neighbours' deposits meet in a texel: one there for all of a block's.
  const auto merge = [](std::vector<Deposit>& of_block, std::vector<Deposit>& out) {
    std::ranges::stable_sort(of_block, {}, &Deposit::place);
    const std::size_t first = out.size();
    for (const Deposit& p : of_block) {
      if (out.size() == first || out.back().place() != p.place()) {
        out.push_back(p);
        continue;
      }
      Deposit& here = out.back();
      for (std::size_t c = 0; c < 3; ++c) here.excess[c] += p.excess[c];
      here.thin = std::min(here.thin, p.thin), here.wide = std::max(here.wide, p.wide);
    }
    of_block.clear();
  };
  // Pieces of the list in parallel, taken up in order.
  constexpr std::size_t piece = 64;
  std::vector<std::vector<Deposit>> deposits((blocks.size() + piece - 1) / piece);
  tbb::parallel_for(std::size_t{0}, deposits.size(), [&](std::size_t k) {
    SolidAngles solid_angles(*layout_, placement_, faces_);
    std::vector<Deposit> of_block;
    for (std::size_t i = k * piece; i < std::min(blocks.size(), (k + 1) * piece); ++i) {
      spread(blocks[i], solid_angles, of_block);
      merge(of_block, deposits[k]);
    }
  });
  for (std::vector<Deposit>& some : deposits) {
    for (const Deposit& p : some) {
      Highlights::Texel& texel = block_at(p.face, p.x, p.y, true)->add(Highlights::place(p.x, p.y));
      for (std::size_t c = 0; c < 3; ++c) texel.excess[c] += p.excess[c];
      const SourceFace& s = faces_[static_cast<std::size_t>(p.face)];
      highlights_.slivers.push_back({layout_->direction(p.face, u_from_texel(p.x - apron_, s.size.width, placement_),
                                                        u_from_texel(p.y - apron_, s.size.height, placement_)),
                                     p.thin, p.wide});
    }
    some = {};
  }
}

void Source::copy_highlights(const Orphans& orphans) {
  orphans.for_each([&](const Orphan& o) {
    Highlights::Copy copy{o.face, o.x, o.y, o.from_face, {}, {}, {}};
    const SourceFace& s = faces_[static_cast<std::size_t>(o.from_face)];
    const int x0 = static_cast<int>(std::floor(o.from_x)), y0 = static_cast<int>(std::floor(o.from_y));
    const float fx = static_cast<float>(o.from_x - x0), fy = static_cast<float>(o.from_y - y0);
    bool any = false;
    for (int k = 0; k < 4; ++k) {
      copy.from_x[k] = std::clamp(x0 + (k & 1), apron_, apron_ + s.size.width - 1);
      copy.from_y[k] = std::clamp(y0 + (k >> 1), apron_, apron_ + s.size.height - 1);
      copy.weight[k] = (k & 1 ? fx : 1 - fx) * (k >> 1 ? fy : 1 - fy);
      const Highlights::Texel* texel = highlight_at(o.from_face, copy.from_x[k], copy.from_y[k]);
      any = any || (texel && copy.weight[k] > 0 && texel->lit());
    }
    if (any) highlights_.copies.push_back(copy);
  });
  for (const Highlights::Copy& c : highlights_.copies) {
    Highlights::Block& block = *block_at(c.face, c.x, c.y, true);
    block.add(Highlights::place(c.x, c.y));
    block.repeats.add(Highlights::place(c.x, c.y));
  }
  for (Highlights::Block& block : highlights_.blocks) block.shrink();
  repeat_highlights();
  mark_highlights();
}

// Where reads meet highlights: by texel for bilinear ones, which take texels x and x + 1, and by block for wider ones,
// which reach no further than the next block.
void Source::mark_highlights() {
  constexpr int side = Highlights::side;
  static_assert(most_taps <= side);
  for (const SourceFace& s : faces_)
    for (int by = 0; by < s.rows; by += side)
      for (int bx = 0; bx < s.columns; bx += side) {
        const Highlights::Block* block = highlights_.block_at(s, bx, by);
        if (!block) continue;
        for (int y = std::max(by - side, 0); y < std::min(by + 2 * side, s.rows); y += side)
          for (int x = std::max(bx - side, 0); x < std::min(bx + 2 * side, s.columns); x += side)
            highlights_.touched[Highlights::block_number(s, x, y)] = 1;
        for (int k = 0; k < side * side; ++k) {
          const Highlights::Texel* texel = block->find(k);
          if (!texel || !texel->lit()) continue;
          for (int y = std::max(by + k / side - 1, 0); y <= by + k / side; ++y)
            for (int x = std::max(bx + k % side - 1, 0); x <= bx + k % side; ++x) {
              std::int32_t& index = highlights_.mask_index[Highlights::block_number(s, x, y)];
              if (index < 0) {
                index = static_cast<std::int32_t>(highlights_.masks.size());
                highlights_.masks.push_back({});
              }
              highlights_.masks[static_cast<std::size_t>(index)].add(Highlights::place(x, y));
            }
        }
      }
}

void Source::repeat_highlights() {
  for (const Highlights::Copy& c : highlights_.copies) {
    float sum[3]{};
    for (int k = 0; k < 4; ++k) {
      const Highlights::Texel* from = highlight_at(c.from_face, c.from_x[k], c.from_y[k]);
      if (!from) continue;
      for (int i = 0; i < 3; ++i) sum[i] += c.weight[k] * from->excess[i];
    }
    std::copy_n(sum, 3, highlight_at(c.face, c.x, c.y)->excess);
  }
}

void Source::add_highlights(int face, int x, int y, float fx, float fy, float* value) const {
  const SourceFace& s = faces_[static_cast<std::size_t>(face)];
  if (!highlights_.any() || !highlights_.reach(s, x, y)) return;
  HighlightQuad<const Highlights::Texel> quad;
  const Place place{x, y, fx, fy};
  quad.move(highlights_, s, static_cast<float>(face), place);
  for (int k = 0; k < 4; ++k) {
    if (!quad.texel[k]) continue;
    const float weight = quad.weight(k, place);
    for (int c = 0; c < 3; ++c) value[c] += weight * quad.texel[k]->excess[c];
  }
}

std::vector<StrandedEnergy> Source::conserve_highlights() {
  std::vector<StrandedEnergy> stranded;
  if (!highlights_.any()) return stranded;
  // What a repeated texel received came from its owners' excess.
  for (const Highlights::Copy& c : highlights_.copies) {
    const std::uint64_t received = highlight_at(c.face, c.x, c.y)->received;
    for (int k = 0; k < 4; ++k)
      if (Highlights::Texel* owner = highlight_at(c.from_face, c.from_x[k], c.from_y[k]))
        owner->received += static_cast<std::uint64_t>(static_cast<double>(received) * static_cast<double>(c.weight[k]));
  }
  constexpr int side = Highlights::side;
  for (int f = 0; f < layout_->face_count(); ++f) {
    const SourceFace& s = faces_[static_cast<std::size_t>(f)];
    const int down = (s.rows + side - 1) / side;
    std::vector<std::vector<StrandedEnergy>> by_block(static_cast<std::size_t>(s.blocks * down));
    tbb::parallel_for(0, s.blocks * down, [&](int b) {
      const std::int32_t index = highlights_.index[static_cast<std::size_t>(s.first_block + b)];
      if (index < 0) return;
      Highlights::Block& block = highlights_.blocks[static_cast<std::size_t>(index)];
      // The block's texels that are in the face.
      const int x0 = std::max(b % s.blocks * side, apron_), y0 = std::max(b / s.blocks * side, apron_);
      const int x1 = std::min((b % s.blocks + 1) * side, apron_ + s.size.width);
      const int y1 = std::min((b / s.blocks + 1) * side, apron_ + s.size.height);
      if (x0 >= x1 || y0 >= y1) return;
      double omega[side * side];
      texel_solid_angles(*layout_, f, s.size, placement_, x0 - apron_, y0 - apron_, x1 - x0, y1 - y0, omega);
      for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x1; ++x) {
          Highlights::Texel* texel = block.find(Highlights::place(x, y));
          // A copy is of a face that the layout does not own at the texel's centre.
          if (!texel || !texel->lit() || block.repeats.holds(Highlights::place(x, y))) continue;
          float* e = texel->excess;
          const double own = omega[(y - y0) * (x1 - x0) + (x - x0)];
          const double got = static_cast<double>(texel->received) * Highlights::received_unit;
          if (got > 0) {
            const float scale = static_cast<float>(own / got);
            for (int c = 0; c < 3; ++c) e[c] *= scale;
            continue;
          }
          StrandedEnergy lost{};
          lost.direction = layout_->direction(f, u_from_texel(x - apron_, s.size.width, placement_),
                                              u_from_texel(y - apron_, s.size.height, placement_));
          for (int c = 0; c < 3; ++c) lost.energy[c] = own * static_cast<double>(e[c]), e[c] = 0;
          by_block[static_cast<std::size_t>(b)].push_back(lost);
        }
    });
    for (const auto& block : by_block) stranded.insert(stranded.end(), block.begin(), block.end());
  }
  repeat_highlights();
  return stranded;
}

}  // namespace envconv
