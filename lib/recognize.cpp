// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <numeric>
#include <optional>
#include <string_view>
#include <utility>

#include "assertion.h"
#include "mip.h"
#include "recognize_shared.h"
#include "texture_file.h"

namespace envconv {

namespace {

Size size_of(const Picture& picture) { return {picture.image.width(), picture.image.height()}; }

// --- one picture

// Shapes that have one usual meaning.
struct UsualShape {
  int width, height;  // in faces, or in halves of a panorama
  const char* layout;
  const char* packing;
  enum When { always, when_unused_cells_are_constant, when_packing_is_given } when;
};
constexpr UsualShape usual_shapes[] = {
    {2, 1, "latlong", "row", UsualShape::always},
    {6, 1, "cube", "row", UsualShape::always},
    {1, 6, "cube", "column", UsualShape::always},
    {4, 3, "cube", "cross", UsualShape::when_unused_cells_are_constant},
    {3, 4, "cube", "vcross", UsualShape::when_unused_cells_are_constant},
    {3, 2, "equi-angular-cube", "youtube", UsualShape::when_packing_is_given},
};

Result<Recognition> take(Recognition r, const Fit& found, std::string how) {
  ENVCONV_ASSERT(found.layout && found.packing && found.height >= 1);
  r.layout = found.layout;
  r.packing = found.packing;
  r.height = found.height;
  r.how = std::move(how);
  return r;
}

Result<Recognition> recognize_known(const PictureFile& file, const InputHints& hints, const Recorded& recorded,
                                    Recognition r) {
  const Size size = size_of(file.pictures[0]);
  const bool is_told = hints.layout != nullptr;
  const Layout& layout = is_told ? *hints.layout : *recorded.layout;
  const std::string how = is_told ? "as told (" + text(layout.name()) + ")" : "from its metadata (envconv:layout)";
  const auto misfit = [&](const std::string& expected) {
    return Error{ErrorCode::input, file.path + ": " + text(size) + " does not fit " + text(layout.name()) +
                                       (is_told ? "" : ", which its metadata names") + ": expected " + expected +
                                       (is_told ? "" : " (if it was changed since, say what it is with --from)")};
  };
  if (hints.packing) {
    if (!packs(*hints.packing, layout))
      return Error{ErrorCode::input, file.path + ": " + packed_shape(layout, *hints.packing, 1).error().message};
    if (const std::optional<Fit> found = fit(layout, *hints.packing, size)) return take(std::move(r), *found, how);
    if (is_apart(*hints.packing)) return misfit(ratio(layout, default_packing(layout)));
    return misfit(ratio(layout, *hints.packing) + " (" + text(hints.packing->name) + ")");
  }
  const Packing* packing = recorded.layout == &layout ? recorded.packing : nullptr;
  if (packing) {
    if (const std::optional<Fit> found = fit(layout, *packing, size)) return take(std::move(r), *found, how);
    if (is_apart(*packing) && !is_told && layout.face_count() > 1)
      return Error{ErrorCode::input, file.path + ": one face of the " + std::to_string(layout.face_count()) + " of " +
                                         text(layout.name()) + " (give all of them, with {face} in the name)"};
  }
  const std::optional<Fit> found = fit_any(layout, size);
  if (!found) return misfit(expected_shapes(layout));
  if (packing)
    r.warnings.push_back("its metadata says packing " + text(packing->name) + ", but its size is that of " +
                         text(found->packing->name));
  return take(std::move(r), *found, how);
}

// Of one picture that is said to be stored apart, only the layout is unknown.
const Packing* told_packing(const InputHints& hints) {
  return hints.packing && !is_apart(*hints.packing) ? hints.packing : nullptr;
}

Result<Recognition> recognize_one(const PictureFile& file, const InputHints& hints, const Recorded& recorded,
                                  Recognition r) {
  const Image& image = file.pictures[0].image;
  const Size size = size_of(file.pictures[0]);
  if (hints.layout || recorded.layout) return recognize_known(file, hints, recorded, std::move(r));
  const Packing* told = told_packing(hints);

  if (const auto entry = file.metadata.find("envmap"); entry != file.metadata.end()) {
    const bool is_cube = entry->second == "cube";
    const Layout* layout = find_layout(is_cube ? "openexr-cube" : "latlong-inclusive");
    if (!is_cube && entry->second != "latlong")
      return Error{ErrorCode::input, file.path + ": its envmap attribute is \"" + printable(entry->second) +
                                         "\", which is no kind of environment that is known (say what it is with "
                                         "--from)"};
    if (const std::optional<Fit> found = fit(*layout, told ? *told : default_packing(*layout), size)) {
      return take(std::move(r), *found, "from its envmap attribute (" + entry->second + ")");
    } else {
      r.warnings.push_back("its envmap attribute says " + entry->second + ", but " + text(size) + " is not " +
                           ratio(*layout, default_packing(*layout)) + ": ignored");
    }
  }

  for (const UsualShape& usual : usual_shapes) {
    const Layout& layout = *find_layout(usual.layout);
    const Packing& packing = *find_packing(usual.packing);
    if (told ? told != &packing : usual.when == UsualShape::when_packing_is_given) continue;
    const std::optional<Fit> found = fit(layout, packing, size);
    if (!found) continue;
    std::string how = std::to_string(usual.width) + ":" + std::to_string(usual.height) + " is " + text(layout.name());
    if (layout.face_count() > 1) how += " in a " + text(packing.name);
    if (!told && usual.when == UsualShape::when_unused_cells_are_constant) {
      if (image.empty())
        how += ", presumably: pixels were not read";
      else if (!unused_cells_are_constant(image, *packed_shape(layout, packing, found->height)))
        continue;
      else
        how += ", unused cells empty";
    }
    return take(std::move(r), *found, std::move(how));
  }

  const auto [fits, names] = possible_fits(size, told);
  if (fits.size() == 1) return take(std::move(r), fits[0], text(size) + " can be nothing but " + names[0]);
  std::string because;
  for (const std::string& warning : r.warnings) because += "; " + warning;
  if (fits.empty())
    return Error{ErrorCode::input, file.path + ": " + text(size) + " is the shape of no layout" +
                                       (told ? " in packing " + text(told->name) : "") + because +
                                       " (a panorama is 2:1; envconv layouts lists all shapes)"};
  return Error{ErrorCode::input, file.path + ": " + text(size) + " could be any of " + joined(names) + because +
                                     " (say which with --from)"};
}

// --- a picture for every face

// For every face the picture that has its name; empty when names do not match one to one.
std::vector<std::size_t> order_by_name(const Layout& layout, const std::vector<Picture>& pictures) {
  std::vector<std::size_t> order;
  if (pictures.size() != layout.info().faces.size()) return order;
  for (const Face& face : layout.info().faces) {
    const auto found =
        std::ranges::find(pictures, face.name, [](const Picture& p) -> std::string_view { return p.name; });
    if (found == pictures.end()) return {};
    order.push_back(static_cast<std::size_t>(found - pictures.begin()));
  }
  return order;
}

// By name, or as they come.
std::vector<std::size_t> order_of(const Layout& layout, const std::vector<Picture>& pictures) {
  std::vector<std::size_t> order = order_by_name(layout, pictures);
  if (order.empty()) {
    order.resize(pictures.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
  }
  return order;
}

// The first picture that is not of the size its face should have, in words; "" when all are.
std::string wrong_face(const Layout& layout, const std::vector<Picture>& pictures) {
  ENVCONV_ASSERT(pictures.size() == layout.info().faces.size());
  const std::vector<std::size_t> order = order_of(layout, pictures);
  const int height = pictures[order[0]].image.height();
  if (height < 1) return "its first face is empty";
  for (int f = 0; f < layout.face_count(); ++f) {
    const Size size = size_of(pictures[order[static_cast<std::size_t>(f)]]), expected = face_size(layout, f, height);
    if (size != expected)
      return "face " + text(layout.info().faces[static_cast<std::size_t>(f)].name) + " of " + text(layout.name()) +
             " is " + text(size) + ", expected " + text(expected);
  }
  return "";
}

// The layouts whose faces have the names and sizes of these pictures.
std::vector<const Layout*> layouts_by_face_names(const std::vector<Picture>& pictures) {
  std::vector<const Layout*> named;
  for (const Layout& layout : all_layouts())
    if (!order_by_name(layout, pictures).empty() && wrong_face(layout, pictures).empty()) named.push_back(&layout);
  return named;
}

// The layouts that pictures could be the faces of: by name, or the layers of an array by number and size.
std::vector<const Layout*> possible_layouts(const PictureFile& file) {
  std::vector<const Layout*> possible = layouts_by_face_names(file.pictures);
  if (!possible.empty() || !is_texture_file(file.format)) return possible;
  for (const Layout& layout : all_layouts())
    if (layout.info().faces.size() == file.pictures.size() && wrong_face(layout, file.pictures).empty())
      possible.push_back(&layout);
  return possible;
}

Result<Recognition> recognize_faces(const PictureFile& file, const InputHints& hints, const Recorded& recorded,
                                    Recognition r) {
  const std::vector<Picture>& pictures = file.pictures;
  const std::string holds =
      file.path + ": holds " + std::to_string(pictures.size()) + (pictures.size() == 1 ? " picture" : " pictures");
  if (hints.packing && !is_apart(*hints.packing))
    return Error{ErrorCode::input, holds + ", not one in packing " + text(hints.packing->name)};

  if (hints.layout) {
    r.layout = hints.layout;
    r.how = "as told (" + text(r.layout->name()) + ")";
  } else if (recorded.layout) {
    r.layout = recorded.layout;
    r.how = "from its metadata (envconv:layout)";
  } else {
    const std::vector<const Layout*> named = possible_layouts(file);
    std::vector<std::string> names;
    for (const Layout* layout : named) names.push_back(text(layout->name()));
    // The cube's face names are everybody's; of other families no member is the usual one.
    const Layout* cube = find_layout("cube");
    if (is_texture_file(file.format) && pictures[0].name.empty()) {
      if (named.size() > 1)
        return Error{ErrorCode::input, holds + ", which could be any of " + joined(names) + " (say which with --from)"};
      if (named.empty())
        return Error{ErrorCode::input, holds + " of " + text(size_of(pictures[0])) +
                                           ", which are the faces of no layout (envconv layouts lists all)"};
      r.layout = named[0];
      r.how = std::to_string(pictures.size()) + " layers can be nothing but " + names[0];
    } else if (is_texture_file(file.format)) {
      r.layout = cube;
      r.how = "a cube map";
    } else if (named.size() == 1 || std::ranges::find(named, cube) != named.end()) {
      r.layout = named.size() == 1 ? named[0] : cube;
      r.how = "from the names of its pictures (" + text(r.layout->info().faces[0].name) + " ...)";
    } else if (named.size() > 1) {
      return Error{ErrorCode::input, holds + " with the face names of " + joined(names) + " (say which with --from)"};
    } else if (pictures.size() == 6) {
      r.layout = cube;
      r.how = "six pictures are the faces of a cube";
    } else {
      return Error{ErrorCode::input, holds + ", which are no layout's faces by name (say which layout with --from)"};
    }
  }
  if (pictures.size() != r.layout->info().faces.size())
    return Error{ErrorCode::input, holds + ", where " + text(r.layout->name()) + " has " +
                                       std::to_string(r.layout->face_count()) +
                                       (r.layout->face_count() == 1 ? " face" : " faces")};
  if (const std::string wrong = wrong_face(*r.layout, pictures); !wrong.empty())
    return Error{ErrorCode::input, file.path + ": " + wrong};
  if (order_by_name(*r.layout, pictures).empty() &&
      std::ranges::any_of(pictures, [](const Picture& p) { return !p.name.empty(); }))
    r.warnings.push_back("its pictures do not have the names of the faces of " + text(r.layout->name()) +
                         ": taken in the order in which they come");
  r.height = pictures[order_of(*r.layout, pictures)[0]].image.height();
  if (hints.packing)
    r.packing = hints.packing;
  else
    r.packing = find_packing(file.format == "openexr" || is_texture_file(file.format) ? "parts" : "files");
  return r;
}

// Parts are faces, or else passes and views of a renderer: the first of them is its picture.
Result<Recognition> recognize_parts(const PictureFile& file, const InputHints& hints, const Recorded& recorded,
                                    const Recognition& r) {
  Result<Recognition> faces = recognize_faces(file, hints, recorded, r);
  if (faces) return faces;
  Result<Recognition> first = recognize_one(file, hints, recorded, r);
  if (!first) return faces;
  first->first_only = true;
  std::vector<std::string> others;
  for (std::size_t i = 1; i < file.pictures.size() && i <= 8; ++i) {
    const std::string& name = file.pictures[i].name;
    others.push_back(name.empty() ? std::to_string(i) : printable(name));
  }
  if (file.pictures.size() > 9) others.push_back("...");
  first->warnings.push_back("only the first of its " + std::to_string(file.pictures.size()) +
                            " parts is read (the others: " + joined(others) + ")");
  return first;
}

// --- levels and gutters

// The faces' sizes that the metadata implies.
std::vector<Size> stored_sizes(const Layout& layout, const RecordedLevels& levels, int level) {
  std::vector<Size> sizes;
  for (int f = 0; f < layout.face_count(); ++f) {
    Size size = level_size(face_size(layout, f, levels.height), level);
    size.width += 2 * levels.seam.gutter(), size.height += 2 * levels.seam.gutter();
    sizes.push_back(size);
  }
  return sizes;
}

// A file whose faces have other sizes than a height implies, if its metadata tells which and they are right.
std::optional<Recognition> recognize_recorded_sizes(const PictureFile& file, const InputHints& hints,
                                                    const Recorded& recorded, const Recognition& known) {
  if (!recorded.layout || recorded.levels.height == 0) return std::nullopt;
  const Layout& layout = *recorded.layout;
  const int level = recorded.levels.level + file.level;
  Recognition r = known;
  r.layout = &layout;
  r.packing = hints.packing ? hints.packing : recorded.packing ? recorded.packing : &default_packing(layout);
  r.stored = stored_sizes(layout, recorded.levels, level);
  r.height = r.stored[0].height - 2 * recorded.levels.seam.gutter();
  r.how = "from its metadata (envconv:layout" + (level > 0 ? ", level " + std::to_string(level) : "") + ")";
  if (file.pictures.size() > 1 || is_apart(*r.packing)) {
    if (file.pictures.size() != r.stored.size()) return std::nullopt;
    const std::vector<std::size_t> order = order_of(layout, file.pictures);
    for (std::size_t f = 0; f < order.size(); ++f)
      if (size_of(file.pictures[order[f]]) != r.stored[f]) return std::nullopt;
    return r;
  }
  const Result<PackedShape> shape = packed_shape(layout, *r.packing, r.stored);
  if (!shape || shape->size != size_of(file.pictures[0])) return std::nullopt;
  return r;
}

}  // namespace

Result<Recognition> recognize(const PictureFile& file, const InputHints& hints) {
  if (file.pictures.empty()) return Error{ErrorCode::input, file.path + ": holds no picture"};
  Recognition r;
  const Recorded recorded = read_metadata(file.metadata, r.warnings);
  r.frame = hints.frame ? hints.frame : recorded.frame ? recorded.frame : find_frame("world");
  r.rotation = recorded.rotation;
  const Layout* known = hints.layout ? hints.layout : recorded.layout;
  if (known && known == recorded.layout) {
    r.seam = recorded.levels.seam;
    if (std::optional<Recognition> found = recognize_recorded_sizes(file, hints, recorded, r)) return std::move(*found);
    // Gutters of a size that is not recorded could be anywhere.
    if (r.seam.gutter() > 0) r.seam = {};
  }
  const bool wants_faces = hints.packing && is_apart(*hints.packing) && known && known->face_count() > 1;
  if (file.pictures.size() > 1 && !wants_faces && file.format == "openexr")
    return recognize_parts(file, hints, recorded, std::move(r));
  if (file.pictures.size() > 1 || wants_faces) return recognize_faces(file, hints, recorded, std::move(r));
  return recognize_one(file, hints, recorded, std::move(r));
}

std::vector<std::string> candidates(const PictureFile& file, const InputHints& hints) {
  if (file.pictures.empty() || recognize(file, hints)) return {};
  std::vector<std::string> warnings;
  if (hints.layout || read_metadata(file.metadata, warnings).layout) return {};  // known, and does not fit
  if (file.pictures.size() == 1) return possible_fits(size_of(file.pictures[0]), told_packing(hints)).names;
  std::vector<std::string> names;
  for (const Layout* layout : possible_layouts(file)) names.push_back(text(layout->name()));
  return names;
}

Placement placement_of(const Recognition& recognition) { return placement_for(*recognition.layout, recognition.seam); }

namespace {

// The faces as they are stored.
Result<std::vector<Image>> stored_faces(PictureFile& file, const Recognition& recognition) {
  const Layout& layout = *recognition.layout;
  if (!is_apart(*recognition.packing) && file.pictures.size() == 1) {
    Image& image = file.pictures[0].image;
    if (!recognition.stored.empty()) {
      const Result<PackedShape> shape = packed_shape(layout, *recognition.packing, recognition.stored);
      if (!shape || shape->size != Size{image.width(), image.height()})
        return Error{ErrorCode::input, file.path + ": has not the size that was recognised"};
      return unpack(*shape, std::move(image));
    }
    Result<std::vector<Image>> faces = unpack(layout, *recognition.packing, std::move(image));
    if (!faces) return Error{faces.error().code, file.path + ": " + faces.error().message};
    return faces;
  }
  if (file.pictures.size() != layout.info().faces.size())
    return Error{ErrorCode::input, file.path + ": is not one picture for each face of " + text(layout.name())};
  const std::vector<std::size_t> order = order_of(layout, file.pictures);
  std::string wrong = recognition.stored.empty() ? wrong_face(layout, file.pictures) : "";
  for (std::size_t f = 0; f < recognition.stored.size(); ++f)
    if (size_of(file.pictures[order[f]]) != recognition.stored[f]) wrong = "its faces have not the sizes recognised";
  if (!wrong.empty()) return Error{ErrorCode::input, file.path + ": " + wrong};
  std::vector<Image> faces;
  for (const std::size_t i : order) faces.push_back(std::move(file.pictures[i].image));
  return faces;
}

}  // namespace

Result<EnvImage> to_environment(PictureFile file, const Recognition& recognition, std::vector<Image>* grown) {
  const Layout* layout = recognition.layout;
  if (!layout || !recognition.packing || !recognition.frame || file.pictures.empty())
    return Error{ErrorCode::usage, file.path + ": was not recognised"};
  if (recognition.first_only) file.pictures.resize(1);
  const Channels& channels = file.pictures[0].channels;
  for (const Picture& picture : file.pictures) {
    if (picture.image.empty()) return Error{ErrorCode::usage, file.path + ": its pixels were not read"};
    if (picture.channels != channels || picture.image.channels() != channels.count())
      return Error{ErrorCode::input, file.path + ": its pictures differ in channels"};
  }

  EnvImage environment;
  environment.layout = layout;
  environment.placement = placement_of(recognition);
  environment.consumer_from_world = recognition.frame->consumer_from_world;
  environment.channels = channels;
  ENVCONV_TRY(environment.faces, stored_faces(file, recognition));
  if (recognition.seam.gutter() > 0) {
    std::vector<Image> middle =
        without_gutters(*layout, environment.placement, environment.faces, recognition.seam.gutter());
    if (grown) *grown = std::move(environment.faces);
    environment.faces = std::move(middle);
  }
  return environment;
}

}  // namespace envconv
