// SPDX-License-Identifier: Apache-2.0
#include "program/flags.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "absl/flags/commandlineflag.h"
#include "absl/flags/reflection.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

namespace holdfast {
namespace {

constexpr size_t kWrapColumns = 78;

// absl brings flags of its own (help, flagfile, ...); they are none of the program's.
bool IsProgramFlag(const absl::CommandLineFlag& flag) {
  return !flag.IsRetired() && !absl::StrContains(flag.Filename(), "absl/flags/");
}

absl::CommandLineFlag* FindProgramFlag(absl::string_view name) {
  absl::CommandLineFlag* flag = absl::FindCommandLineFlag(name);
  return flag != nullptr && IsProgramFlag(*flag) ? flag : nullptr;
}

absl::Status SetFlag(absl::CommandLineFlag& flag, absl::string_view value, absl::string_view shown_name) {
  std::string error;
  if (flag.ParseFrom(value, &error)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(shown_name, ": ", error));
}

// --switch without a value, and --noswitch.
std::optional<absl::Status> SetSwitch(absl::string_view name) {
  absl::CommandLineFlag* flag = FindProgramFlag(name);
  if (flag != nullptr && flag->IsOfType<bool>()) return SetFlag(*flag, "true", name);
  absl::string_view positive = name;
  if (flag != nullptr || !absl::ConsumePrefix(&positive, "no")) return std::nullopt;
  flag = FindProgramFlag(positive);
  if (flag == nullptr || !flag->IsOfType<bool>()) return std::nullopt;
  return SetFlag(*flag, "false", name);
}

// Sets the flag that args[i] names and returns the number of arguments it took.
absl::StatusOr<size_t> ParseOneFlag(const std::vector<std::string>& args, size_t i) {
  const absl::string_view text = absl::StripPrefix(absl::StripPrefix(args[i], "-"), "-");
  const std::pair<absl::string_view, absl::string_view> parts = absl::StrSplit(text, absl::MaxSplits('=', 1));
  const std::string shown = absl::StrCat("--", parts.first);
  const bool has_value = absl::StrContains(text, '=');
  if (!has_value) {
    if (const auto set = SetSwitch(parts.first)) {
      if (!set->ok()) return *set;
      return 1;
    }
  }
  absl::CommandLineFlag* flag = FindProgramFlag(parts.first);
  if (flag == nullptr) return absl::InvalidArgumentError(absl::StrCat("unknown flag ", shown));
  if (!has_value && i + 1 == args.size()) return absl::InvalidArgumentError(absl::StrCat(shown, " needs a value"));
  const absl::Status set = SetFlag(*flag, has_value ? parts.second : absl::string_view(args[i + 1]), shown);
  if (!set.ok()) return set;
  return has_value ? 1 : 2;
}

std::string Wrap(absl::string_view text, size_t indent) {
  std::string out(indent, ' ');
  size_t column = indent;
  for (absl::string_view word : absl::StrSplit(text, ' ', absl::SkipEmpty())) {
    if (column > indent && column + 1 + word.size() > kWrapColumns) {
      absl::StrAppend(&out, "\n", std::string(indent, ' '));
      column = indent;
    }
    absl::StrAppend(&out, column > indent ? " " : "", word);
    column += word.size() + (column > indent ? 1 : 0);
  }
  return out;
}

std::string DescribeFlag(const absl::CommandLineFlag& flag) {
  const std::string value = flag.DefaultValue();
  const bool plain = value.empty() || value == "\"\"" || value == "false";
  return absl::StrCat("  --", flag.Name(), plain ? "" : absl::StrCat("=", value), "\n", Wrap(flag.Help(), 6), "\n");
}

}  // namespace

absl::string_view ProgramVersion() { return HOLDFAST_VERSION; }

bool AnswerQuestion(const Program& program, const std::vector<std::string>& args, std::ostream& out) {
  const auto has = [&](absl::string_view question) { return std::count(args.begin(), args.end(), question) > 0; };
  if (has("--help")) {
    out << program.usage << "\n\n";
    for (const absl::CommandLineFlag* flag : ProgramFlags()) out << DescribeFlag(*flag);
    return true;
  }
  if (has("--version")) out << program.name << " " << ProgramVersion() << "\n";
  return has("--version");
}

absl::Status SetFlagsFromEnvironment(absl::string_view prefix, const EnvironmentLookup& getenv) {
  for (const auto& [name, flag] : absl::GetAllFlags()) {
    if (!IsProgramFlag(*flag)) continue;
    const std::string variable = absl::StrCat(prefix, absl::AsciiStrToUpper(name));
    const char* value = getenv(variable.c_str());
    if (value == nullptr) continue;
    const absl::Status set = SetFlag(*flag, value, absl::StrCat("environment variable ", variable));
    if (!set.ok()) return set;
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<std::string>> ParseFlags(const std::vector<std::string>& args) {
  std::vector<std::string> rest;
  for (size_t i = 0; i < args.size();) {
    if (args[i] == "--") {
      rest.insert(rest.end(), args.begin() + static_cast<std::ptrdiff_t>(i) + 1, args.end());
      break;
    }
    if (args[i].size() < 2 || args[i][0] != '-') {  // "-" alone is an ordinary argument
      rest.push_back(args[i++]);
      continue;
    }
    const absl::StatusOr<size_t> taken = ParseOneFlag(args, i);
    if (!taken.ok()) return taken.status();
    i += *taken;
  }
  return rest;
}

absl::Status SetFlags(const std::vector<std::string>& args, const EnvironmentLookup& getenv) {
  const absl::Status environment = SetFlagsFromEnvironment("HOLDFAST_", getenv);
  if (!environment.ok()) return environment;
  const absl::StatusOr<std::vector<std::string>> rest = ParseFlags(args);
  if (!rest.ok() || rest->empty()) return rest.status();
  return absl::InvalidArgumentError(absl::StrCat("unexpected argument \"", rest->front(), "\""));
}

std::vector<const absl::CommandLineFlag*> ProgramFlags() {
  std::vector<const absl::CommandLineFlag*> flags;
  for (const auto& [name, flag] : absl::GetAllFlags()) {
    if (IsProgramFlag(*flag)) flags.push_back(flag);
  }
  std::sort(flags.begin(), flags.end(), [](const auto* a, const auto* b) { return a->Name() < b->Name(); });
  return flags;
}

std::string DescribeFlags(const std::vector<absl::string_view>& names) {
  std::string out;
  for (absl::string_view name : names) absl::StrAppend(&out, DescribeFlag(*absl::FindCommandLineFlag(name)));
  return out;
}

}  // namespace holdfast
