// SPDX-License-Identifier: Apache-2.0
#include "options.h"

#include "resample.h"
#include "text.h"

namespace envconv::tool {
namespace {

template <class T>
std::vector<std::string_view> names_of(std::span<const T> all) {
  std::vector<std::string_view> names;
  for (const T& one : all) {
    if constexpr (requires { one.name(); }) {
      names.push_back(one.name());
    } else {
      names.push_back(one.name);
    }
  }
  return names;
}

std::string unknown(const std::string& value, std::string_view kind, const std::vector<std::string_view>& names) {
  const std::string near = did_you_mean(value, names);
  const std::string rest = near.empty() ? "; there are: " + joined(names) : near;
  return "no " + std::string(kind) + " is called '" + value + "'" + rest;
}

// An option whose value is the name of something registered.
template <class T>
Option registry_option(std::string names, std::string value, std::string_view kind, const T*& target,
                       std::vector<std::string_view> choices, const T* (*find)(std::string_view), std::string help) {
  Option option{.names = std::move(names), .value = std::move(value), .help = std::move(help)};
  option.choices = choices;
  option.set = [&target, kind, find, choices](const std::string& name) {
    target = find(name);
    return target ? std::string() : unknown(name, kind, choices);
  };
  return option;
}

constexpr std::array types{PixelType::half,   PixelType::float32,    PixelType::uint8, PixelType::uint16,
                           PixelType::rgb9e5, PixelType::r11g11b10f, PixelType::bc6h};

}  // namespace

std::vector<std::string_view> layout_names() { return names_of(all_layouts()); }
std::vector<std::string_view> packing_names() { return names_of(all_packings()); }
std::vector<std::string_view> frame_names() { return names_of(all_frames()); }
std::vector<std::string_view> filter_names() { return names_of(all_filters()); }

Option switch_option(std::string names, bool& target, std::string help) {
  Option option{.names = std::move(names), .help = std::move(help)};
  option.set = [&target](const std::string&) {
    target = true;
    return std::string();
  };
  return option;
}

Option text_option(std::string names, std::string value, std::string& target, std::string help) {
  Option option{.names = std::move(names), .value = std::move(value), .help = std::move(help)};
  option.set = [&target](const std::string& text) {
    target = text;
    return text.empty() ? std::string("the value is empty") : std::string();
  };
  return option;
}

Option choice_option(std::string names, std::string value, std::string& target, std::vector<std::string_view> choices,
                     std::string help) {
  Option option{.names = std::move(names), .value = std::move(value), .help = std::move(help)};
  option.choices = choices;
  option.set = [&target, choices](const std::string& text) {
    target = text;
    for (const std::string_view choice : choices) {
      if (choice == text) return std::string();
    }
    return "'" + text + "' is not one of " + joined(choices);
  };
  return option;
}

Option integer_option(std::string names, std::string value, int& target, int least, int most, std::string help) {
  Option option{.names = std::move(names), .value = std::move(value), .help = std::move(help)};
  option.set = [&target, least, most](const std::string& text) {
    const auto number = parse_integer(text);
    if (!number || *number < least || *number > most) {
      return "'" + text + "' is not a whole number from " + std::to_string(least) + " to " + std::to_string(most);
    }
    target = static_cast<int>(*number);
    return std::string();
  };
  return option;
}

Option count_option(std::string names, std::string value, std::int64_t& target, std::int64_t most, std::string help) {
  Option option{.names = std::move(names), .value = std::move(value), .help = std::move(help)};
  option.set = [&target, most](const std::string& text) {
    const auto number = parse_count(text);
    if (!number || *number < 1 || *number > most) {
      return "'" + text + "' is not a whole number (or one with k, M or G after it) from 1 to " + std::to_string(most);
    }
    target = *number;
    return std::string();
  };
  return option;
}

Option number_option(std::string names, std::string value, std::optional<double>& target, double least, double most,
                     std::string help) {
  Option option{.names = std::move(names), .value = std::move(value), .help = std::move(help)};
  option.set = [&target, least, most](const std::string& text) {
    target = parse_number(text);
    if (target && *target >= least && *target <= most) return std::string();
    return "'" + text + "' is not a number from " + number_text(least, 9) + " to " + number_text(most, 9);
  };
  return option;
}

Option layout_option(std::string names, const Layout*& target, std::string help) {
  return registry_option<Layout>(std::move(names), "LAYOUT", "layout", target, layout_names(), find_layout,
                                 std::move(help));
}

Option packing_option(std::string names, const Packing*& target, std::string help) {
  return registry_option<Packing>(std::move(names), "PACKING", "packing", target, packing_names(), find_packing,
                                  std::move(help));
}

Option frame_option(std::string names, const Frame*& target, std::string help) {
  return registry_option<Frame>(std::move(names), "FRAME", "frame", target, frame_names(), find_frame, std::move(help));
}

Option filter_option(const Filter*& target) {
  Option option{.names = "--filter",
                .value = "NAME",
                .help = "how the input is weighted over each output texel; auto neither aliases nor blurs",
                .choices = filter_names()};
  option.set = [&target](const std::string& name) {
    target = find_filter(name);
    return target ? std::string() : "no filter is called '" + name + "'; there are: " + joined(filter_names());
  };
  return option;
}

Option rotate_option(Rotation& target) {
  Option option{.names = "--rotate",
                .value = "YAW,PITCH,ROLL",
                .help =
                    "turn the environment by so many degrees: about up (forward goes right), about right (up goes "
                    "forward), about forward (right goes up); roll first, yaw last"};
  option.set = [&target](const std::string& text) {
    const std::size_t one = text.find(','), two = one == std::string::npos ? one : text.find(',', one + 1);
    if (two != std::string::npos) {
      const auto yaw = parse_number(std::string_view(text).substr(0, one));
      const auto pitch = parse_number(std::string_view(text).substr(one + 1, two - one - 1));
      const auto roll = parse_number(std::string_view(text).substr(two + 1));
      if (yaw && pitch && roll) {
        target = {*yaw, *pitch, *roll};
        return std::string();
      }
    }
    return "'" + text + "' is not three numbers with commas between them";
  };
  return option;
}

Option type_option(WriteOptions& target) {
  Option option{.names = "--type",
                .value = "TYPE",
                .help = "type of the stored values; rgb9e5, r11g11b10f and bc6h are for DDS, KTX and KTX2"};
  for (const PixelType type : types) option.choices.push_back(name_of(type));
  option.set = [&target, choices = option.choices](const std::string& text) {
    for (const PixelType type : types) {
      if (name_of(type) != text) continue;
      target.type = type;
      target.type_given = true;
      return std::string();
    }
    return "'" + text + "' is not one of " + joined(choices);
  };
  return option;
}

Option in_group(Option option, std::string group, std::string initial) {
  option.group = std::move(group);
  option.initial = std::move(initial);
  return option;
}

namespace {

constexpr const char* input_group = "Input";

// "--from" + suffix and its kin; `whose` is "the input".
void add_hint_options(Command& command, InputHints& target, const std::string& suffix, const std::string& whose) {
  auto add = [&](Option option, std::string initial) {
    command.options.push_back(in_group(std::move(option), input_group, std::move(initial)));
  };
  add(layout_option("--from" + suffix, target.layout, "layout of " + whose), "recognised");
  add(packing_option("--from-packing" + suffix, target.packing, "how the faces of " + whose + " lie in its image"),
      "recognised");
  add(frame_option("--from-frame" + suffix, target.frame, "axes that " + whose + " was written for"),
      "recognised, or world");
}

}  // namespace

void add_second_input_options(Command& command, InputHints& target) { add_hint_options(command, target, "-b", "B"); }

void add_input_options(Command& command, InputOptions& target) {
  add_hint_options(command, target.hints, "", "the input");
  auto add = [&](Option option, std::string initial) {
    command.options.push_back(in_group(std::move(option), input_group, std::move(initial)));
  };
  add(count_option("--max-pixels", "N", target.read.max_pixels, std::int64_t{1} << 40,
                   "refuse inputs that claim more pixels"),
      "1073741824");
  add(switch_option("--trust-input", target.read.trust_input,
                    "decode in this process: faster for many small files, but a hostile file is not kept apart"),
      "");
}

void add_general_options(Command& command, int& threads) {
  const std::string group = "General";
  command.options.push_back(in_group(integer_option("-j,--threads", "N", threads, 0, 4096,
                                                    "worker threads, at most one a core; 0 stands for all cores"),
                                     group, "all cores"));
  Option quiet{.names = "-q,--quiet", .help = "errors only: no warnings, no progress", .group = group};
  quiet.set = [](const std::string&) {
    set_verbosity(-1);
    return std::string();
  };
  Option verbose{.names = "-v,--verbose", .help = "tell on stderr what is done", .group = group};
  verbose.set = [](const std::string&) {
    set_verbosity(1);
    return std::string();
  };
  command.options.push_back(std::move(quiet));
  command.options.push_back(std::move(verbose));
}

}  // namespace envconv::tool
