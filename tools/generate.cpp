// SPDX-License-Identifier: Apache-2.0
#include "generate.h"

#include <algorithm>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "describe.h"
#include "envconv.h"
#include "options.h"
#include "text.h"

namespace envconv::tool {
namespace {

constexpr std::size_t help_width = 80;
constexpr std::size_t help_indent = 26;  // of descriptions in --help

// "-o, --output PATH"
std::string synopsis(const Option& option) {
  std::string out;
  for (const std::string& name : all_names(option)) out += (out.empty() ? "" : ", ") + name;
  if (!option.optional_value.empty()) return out + "[=" + option.optional_value + "]";
  return option.value.empty() ? out : out + " " + option.value;
}

std::string description(const Option& option) {
  std::string out = option.help;
  if (option.value == "LAYOUT") {
    out += " (see 'envconv layouts')";  // too many to list at each option
  } else if (!option.choices.empty()) {
    out += ": " + joined(option.choices, " ");
  }
  if (!option.initial.empty()) out += " [" + option.initial + "]";
  return out;
}

// The options by heading, in the order in which headings first occur.
std::vector<std::pair<std::string, std::vector<const Option*>>> grouped(const Command& command) {
  std::vector<std::pair<std::string, std::vector<const Option*>>> groups;
  for (const Option& option : command.options) {
    auto group = std::find_if(groups.begin(), groups.end(), [&](const auto& g) { return g.first == option.group; });
    if (group == groups.end()) group = groups.insert(groups.end(), {option.group, {}});
    group->second.push_back(&option);
  }
  return groups;
}

// --- roff -------------------------------------------------------------------------------------------------------

std::string roff(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (c == '\\') {
      out += "\\e";
    } else if (c == '-') {
      out += "\\-";
    } else if ((c == '.' || c == '\'') && (out.empty() || out.back() == '\n')) {
      out += std::string("\\&") + c;
    } else {
      out += c;
    }
  }
  return out;
}

std::string roff_options(const Command& command) {
  std::string out;
  for (const auto& [group, options] : grouped(command)) {
    if (options.empty()) continue;
    out += ".PP\n.I " + roff(group) + "\n";
    for (const Option* option : options) {
      std::string names;
      for (const std::string& name : all_names(*option))
        names += (names.empty() ? "" : ", ") + ("\\fB" + roff(name) + "\\fR");
      out += ".TP\n" + names + (option->value.empty() ? "" : " \\fI" + roff(option->value) + "\\fR") + "\n";
      out += roff(option->help) + ".\n";
      if (option->value == "LAYOUT") {
        out += "See\n.BR envconv\\-layouts (7).\n";
      } else if (!option->choices.empty()) {
        out += "One of: " + roff(joined(option->choices, ", ")) + ".\n";
      }
      if (!option->initial.empty()) out += "Default: " + roff(option->initial) + ".\n";
    }
  }
  return out;
}

std::string roff_commands() {
  std::string out;
  for (const Command& command : all_commands()) {
    out += ".SS envconv " + roff(command.name) + " " + roff(command.operands) + "\n";
    out += roff(command.description) + "\n" + roff_options(command);
  }
  return out;
}

std::string roff_synopsis() {
  std::string out;
  for (const Command& command : all_commands()) {
    out += "\\fBenvconv " + roff(command.name) + "\\fR " + (command.options.empty() ? "" : "[\\fIOPTION\\fR]... ") +
           "\\fI" + roff(command.operands) + "\\fR\n";
  }
  return out;
}

std::string roff_statuses() {
  std::string out;
  for (const ExitStatus& status : exit_statuses()) {
    out += ".TP\n.B " + std::to_string(status.status) + "\n" + roff(status.meaning) + "\n";
  }
  return out;
}

std::string roff_frames() {
  std::string out;
  for (const Frame& frame : all_frames()) {
    out += ".TP\n.B " + roff(frame.name) + "\n" + roff(frame.note) + "\n";
  }
  return out;
}

std::string roff_packings() {
  std::string out;
  for (const Packing& packing : all_packings()) {
    out += ".TP\n.B " + roff(packing.name) + "\n" + roff(packing.note) + "\n";
  }
  return out;
}

// Names and what they mean.
template <class Entries>
std::string roff_notes(const Entries& entries) {
  std::string out;
  for (const auto& entry : entries) {
    out += ".TP\n.B " + roff(entry.name) + "\n" + roff(entry.note) + "\n";
  }
  return out;
}

std::string roff_seams() {
  std::string out;
  for (const SeamKind& kind : all_seam_kinds()) {
    const std::string number = kind.number.empty() ? "" : ":" + std::string(kind.number);
    const bool optional = !number.empty() && !kind.number_needed;
    out += ".TP\n.B " + roff(std::string(kind.name) + (optional ? "[" + number + "]" : number)) + "\n" +
           roff(kind.note) + "\n";
  }
  return out;
}

std::string roff_colorspaces() {
  std::string out;
  const ColorConfig config = ColorConfig::embedded();
  for (const std::string& space : config.spaces()) {
    std::string aliases;
    for (const std::string& alias : config.aliases(space)) aliases += (aliases.empty() ? "" : ", ") + alias;
    out += ".TP\n.B " + roff(space) + "\n" + roff(config.description(space)) +
           (aliases.empty() ? "" : "; also called " + roff(aliases)) + "\n";
  }
  return out;
}

std::string roff_displays() {
  std::string out;
  const ColorConfig config = ColorConfig::embedded();
  for (const std::string& display : config.displays()) {
    const std::vector<std::string> views = config.views(display);
    const std::vector<std::string_view> names(views.begin(), views.end());
    out += ".TP\n.B " + roff(display) + "\n" + roff(joined(names)) + "\n";
  }
  return out;
}

std::string roff_layouts() {
  std::string out;
  for (const Layout& layout : all_layouts()) {
    const LayoutInfo& info = layout.info();
    const LayoutFigures& measured = figures(layout);
    out += ".SS " + roff(layout.name()) + "\n" + roff(info.title) + ".\n";
    if (!info.notes.empty()) out += roff(info.notes) + "\n";
    out += ".PP\n";
    std::string names;
    for (const Face& face : info.faces) names += (names.empty() ? "" : " ") + std::string(face.name);
    out += std::to_string(info.faces.size()) + (info.faces.size() == 1 ? " face" : " faces");
    if (info.faces.size() > 1) out += " (" + roff(names) + ")";
    out += " of " + roff(aspect_text(layout)) + "; packing " + roff(default_packing(layout).name) + "; " +
           (info.equal_area ? "equal\\-area; " : "") + (info.conformal ? "conformal; " : "") + "sampling requirement " +
           number_text(measured.sampling_requirement, 4) + ", anisotropy " + number_text(measured.anisotropy, 3) +
           ", largest to smallest texel " + number_text(measured.texel_ratio, 3) +
           ".\n.br\nSource: " + roff(info.source) + ".\n";
  }
  return out;
}

// --- markdown ---------------------------------------------------------------------------------------------------

std::string markdown_row(const std::vector<std::string>& cells) {
  std::string out = "|";
  for (const std::string& cell : cells) out += " " + cell + " |";
  return out + "\n";
}

std::string markdown_layouts() {
  const auto columns = layout_columns();
  std::string out = markdown_row(columns) + markdown_row(std::vector<std::string>(columns.size(), "---"));
  for (const Layout& layout : all_layouts()) {
    auto row = layout_row(layout);
    row.front() = "`" + row.front() + "`";
    out += markdown_row(row);
  }
  return out;
}

// --- documents --------------------------------------------------------------------------------------------------

const std::map<std::string, std::string (*)()>& sections() {
  static const std::map<std::string, std::string (*)()> all{
      {"SYNOPSIS", roff_synopsis},
      {"COMMANDS", roff_commands},
      {"EXIT_STATUS", roff_statuses},
      {"FILTERS", [] { return roff_notes(all_filters()); }},
      {"MIP_FILTERS", [] { return roff_notes(all_mip_filters()); }},
      {"SEAMS", roff_seams},
      {"FRAMES", roff_frames},
      {"PACKINGS", roff_packings},
      {"COLORSPACES", roff_colorspaces},
      {"DISPLAYS", roff_displays},
      {"LAYOUTS", roff_layouts},
      {"VERSION", [] { return std::string(ENVCONV_VERSION); }}};
  return all;
}

// A word --like-this in a text that no command takes: a reference that leads nowhere.
std::string unknown_option_in(const std::string& text) {
  std::set<std::string> known{"--help", "--version", "--generate"};
  for (const Command& command : all_commands()) {
    for (const Option& option : command.options) {
      for (const std::string& name : all_names(option)) known.insert(name);
    }
  }
  const auto in_word = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '-'; };
  for (std::size_t at = 0; (at = text.find("--", at)) != std::string::npos;) {
    std::size_t end = at + 2;
    while (end < text.size() && in_word(text[end])) ++end;
    const bool starts = at == 0 || !in_word(text[at - 1]);
    const std::string word = text.substr(at, end - at);
    if (starts && word.size() > 2 && std::isalpha(static_cast<unsigned char>(word[2])) && !known.contains(word)) {
      return word;
    }
    at = end;
  }
  return "";
}

Error wrong(const std::string& path, const std::string& what) { return {ErrorCode::internal, path + ": " + what}; }

// Lines that hold @NAME@ alone are replaced by a section, @NAME@ in a line by a word.
Result<std::string> filled_in(const std::string& path, std::istream& lines) {
  std::string out, line;
  while (std::getline(lines, line)) {
    const std::size_t at = line.find('@');
    const std::size_t end = at == std::string::npos ? at : line.find('@', at + 1);
    if (end == std::string::npos) {
      out += line + "\n";
      continue;
    }
    const auto section = sections().find(line.substr(at + 1, end - at - 1));
    if (section == sections().end()) return wrong(path, "no section is called '" + line + "'");
    const std::string text = section->second();
    out += line.substr(0, at) + text + line.substr(end + 1);
    if (out.empty() || out.back() != '\n') out += "\n";
  }
  return out;
}

// The table of layouts goes between its markers.
Result<std::string> readme(const std::string& path, std::istream& lines) {
  std::string out, line;
  bool inside = false, found = false;
  while (std::getline(lines, line)) {
    if (line == "<!-- layouts: end -->") inside = false;
    if (!inside) out += line + "\n";
    if (line == "<!-- layouts: made by envconv --generate readme -->") {
      inside = found = true;
      out += markdown_layouts();
    }
  }
  if (!found || inside) return wrong(path, "the markers of the table of layouts are missing");
  return out;
}

// --- completions ------------------------------------------------------------------------------------------------

// For single quotes in all three shells.
std::string quoted(std::string_view text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

std::string bash_script() {
  std::string verbs, out;
  for (const Command& command : all_commands()) verbs += (verbs.empty() ? "" : " ") + command.name;
  out +=
      "# bash completion of envconv, made by: envconv completion bash\n_envconv() {\n"
      "  local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD-1]} words= options= operands=\n"
      "  COMPREPLY=()\n"
      "  # bash splits --option=value at the sign\n"
      "  [[ $cur == = ]] && cur=\n"
      "  [[ $prev == = ]] && prev=${COMP_WORDS[COMP_CWORD-2]}\n"
      "  if ((COMP_CWORD == 1)); then\n"
      "    COMPREPLY=($(compgen -W '" +
      verbs +
      " --help --version' -- \"$cur\"))\n    return\n  fi\n"
      "  case ${COMP_WORDS[1]} in\n";
  for (const Command& command : all_commands()) {
    std::string options = "--help", cases;
    for (const Option& option : command.options) {
      std::string patterns;
      for (const std::string& name : all_names(option)) {
        options += " " + name;
        patterns += (patterns.empty() ? "" : "|") + name;
      }
      if (option.value.empty()) continue;
      if (!option.choices.empty()) {
        cases += "        " + patterns + ") words='" + joined(option.choices, " ") + "' ;;\n";
      } else if (option.value == "PATH") {
        cases += "        " + patterns + ") COMPREPLY=($(compgen -f -- \"$cur\")); return ;;\n";
      } else {
        cases += "        " + patterns + ") return ;;\n";
      }
    }
    out += "    " + command.name + ")\n      options='" + options + "'\n";
    if (!command.operand_choices.empty()) out += "      operands='" + joined(command.operand_choices, " ") + "'\n";
    if (!cases.empty())
      out += "      case $prev in\n" + cases + "      esac ;;\n";
    else
      out += "      ;;\n";
  }
  out +=
      "    *) return ;;\n  esac\n"
      "  if [[ -n $words ]]; then\n    COMPREPLY=($(compgen -W \"$words\" -- \"$cur\"))\n"
      "  elif [[ $cur == -* ]]; then\n    COMPREPLY=($(compgen -W \"$options\" -- \"$cur\"))\n"
      "  elif [[ -n $operands ]]; then\n    COMPREPLY=($(compgen -W \"$operands\" -- \"$cur\"))\n"
      "  else\n    COMPREPLY=($(compgen -f -- \"$cur\"))\n  fi\n}\n"
      "complete -o filenames -F _envconv envconv\n";
  return out;
}

// A text inside an _arguments specification: brackets and colons have a meaning there.
std::string zsh_text(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if (c == '[' || c == ']' || c == ':' || c == '\\') out += '\\';
    out += c;
  }
  return out;
}

std::string zsh_script() {
  std::string out =
      "#compdef envconv\n# zsh completion of envconv, made by: envconv completion zsh\n"
      "_envconv() {\n  local curcontext=$curcontext state line\n  local -a verbs\n  verbs=(\n";
  for (const Command& command : all_commands()) {
    out += "    " + quoted(command.name + ":" + zsh_text(command.summary)) + "\n";
  }
  out +=
      "  )\n  if (( CURRENT == 2 )); then\n    _describe verb verbs\n    _arguments '--help' '--version'\n    return\n"
      "  fi\n  local verb=$words[2]\n  shift words\n  (( CURRENT-- ))\n  case $verb in\n";
  for (const Command& command : all_commands()) {
    out += "    " + command.name + ")\n      _arguments -s";
    for (const Option& option : command.options) {
      for (const std::string& name : all_names(option)) {
        std::string spec = name;
        if (!option.value.empty() && name.starts_with("--")) spec += "=";
        spec += "[" + zsh_text(option.help) + "]";
        if (!option.value.empty()) {
          spec += ":" + zsh_text(option.value) + ":";
          if (!option.choices.empty())
            spec += "(" + joined(option.choices, " ") + ")";
          else if (option.value == "PATH")
            spec += "_files";
        }
        out += " \\\n        " + quoted(spec);
      }
    }
    out += " \\\n        '--help[show the options]' \\\n        ";
    out += command.operand_choices.empty()
               ? "'*:file:_files'"
               : quoted("*:" + zsh_text(command.operands) + ":(" + joined(command.operand_choices, " ") + ")");
    out += " ;;\n";
  }
  return out +
         "  esac\n}\n"
         // Sourced or found on fpath: both work.
         "if [[ ${funcstack[1]} == _envconv ]]; then\n  _envconv \"$@\"\nelse\n  compdef _envconv envconv\nfi\n";
}

// fish knows two escapes inside single quotes.
std::string fish_quoted(std::string_view text) {
  std::string out = "'";
  for (const char c : text) {
    if (c == '\'' || c == '\\') out += '\\';
    out += c;
  }
  return out + "'";
}

std::string fish_script() {
  std::string out = "# fish completion of envconv, made by: envconv completion fish\n";
  out += "complete -c envconv -n __fish_use_subcommand -l help -d 'show the verbs'\n";
  out += "complete -c envconv -n __fish_use_subcommand -l version -d 'show the version'\n";
  for (const Command& command : all_commands()) {
    out += "complete -c envconv -f -n __fish_use_subcommand -a " + command.name + " -d " +
           fish_quoted(command.summary) + "\n";
  }
  for (const Command& command : all_commands()) {
    const std::string start = "complete -c envconv -n '__fish_seen_subcommand_from " + command.name + "'";
    for (const Option& option : command.options) {
      out += start;
      for (const std::string& name : all_names(option)) {
        out += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
      }
      if (!option.value.empty()) {
        out += option.value == "PATH" ? " -r -F" : " -x";
        if (!option.choices.empty()) out += " -a " + fish_quoted(joined(option.choices, " "));
      }
      out += " -d " + fish_quoted(option.help) + "\n";
    }
    if (!command.operand_choices.empty()) {
      out += start + " -f -a " + fish_quoted(joined(command.operand_choices, " ")) + "\n";
    }
  }
  return out;
}

}  // namespace

const std::vector<std::string_view> completion_shells{"bash", "zsh", "fish"};

std::string completion_script(std::string_view shell) {
  if (shell == "bash") return bash_script();
  if (shell == "zsh") return zsh_script();
  if (shell == "fish") return fish_script();
  return "";
}

std::string general_help() {
  std::string out = "envconv converts environment maps between layouts.\n\n";
  std::vector<std::vector<std::string>> rows;
  for (const Command& command : all_commands()) {
    rows.push_back({"  envconv", command.name + " " + command.operands, command.summary});
  }
  out += table(rows);
  out +=
      "\n"
      "  envconv VERB --help  the options of a verb\n"
      "  envconv --version    versions of envconv and of what it is made with\n"
      "\n"
      "For example:\n"
      "  envconv convert sky.hdr -o sky_cube.exr --to cube\n"
      "  envconv convert 'sky_{face}.png' -o sky.exr --to latlong\n"
      "  envconv info sky_cube.exr\n"
      "\n"
      "The manual: man envconv, envconv-layouts, envconv-metrics, envconv-seams\n";
  return out;
}

std::string command_help(const Command& command) {
  std::string out = "envconv " + command.name + (command.options.empty() ? "" : " [OPTION]...") + " " +
                    command.operands + "\n\n" + wrapped(command.description, 0, help_width) + "\n";
  for (const auto& [group, options] : grouped(command)) {
    out += "\n" + group + "\n";
    for (const Option* option : options) {
      std::string line = "  " + synopsis(*option);
      if (line.size() + 2 > help_indent) {
        out += line + "\n";
        line.clear();
      }
      line.resize(help_indent, ' ');
      out += line + wrapped(description(*option), help_indent, help_width) + "\n";
    }
  }
  return out;
}

Result<std::string> generate(std::string_view kind, const std::string& template_path) {
  std::ifstream file(template_path);
  if (!file) return Error{ErrorCode::input, template_path + ": cannot be read"};
  Result<std::string> text = wrong(template_path, "no document is called '" + std::string(kind) + "'");
  if (kind == "man" || kind == "layouts-man" || kind == "metrics-man" || kind == "seams-man") {
    text = filled_in(template_path, file);
  }
  if (kind == "readme") text = readme(template_path, file);
  if (!text) return text;
  // roff writes hyphens as \-, and a change of font stands before the word.
  std::string plain = *text;
  for (const std::string_view code : {"\\-", "\\fB", "\\fI", "\\fR"}) {
    for (std::size_t at = 0; (at = plain.find(code, at)) != std::string::npos;) {
      plain.replace(at, code.size(), code == "\\-" ? "-" : " ");
    }
  }
  const std::string unknown = kind == "readme" ? "" : unknown_option_in(plain);
  if (!unknown.empty()) return wrong(template_path, "names an option that does not exist: " + unknown);
  return text;
}

}  // namespace envconv::tool
