// SPDX-License-Identifier: Apache-2.0
// holdfast-import IN.pth OUT.safetensors
#include <iostream>
#include <map>
#include <string>
#include <vector>

#include "absl/flags/flag.h"
#include "absl/flags/parse.h"
#include "absl/flags/usage.h"
#include "absl/flags/usage_config.h"
#include "absl/strings/match.h"
#include "model/presets.h"
#include "model/pth_import.h"

ABSL_FLAG(std::string, dtype, "float32", "storage of the parameters: float32, float16 or bfloat16");
ABSL_FLAG(int64_t, context_heads, 8, "heads of the contextual attention, where the checkpoint has one");
ABSL_FLAG(int64_t, context_patch, 7,
          "side of an attention patch in feature pixels, where the checkpoint has attention");
ABSL_FLAG(int64_t, window, 24, "frames of a window that the network was trained with");

namespace {

constexpr char kUsage[] =
    "Converts a published PIPs++ checkpoint (written by torch.save) to safetensors. No code of the file is run.\n"
    "  holdfast-import [flags] IN.pth OUT.safetensors";

int Fail(const std::string& problem) {
  std::cerr << "holdfast-import: " << problem << std::endl;
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  absl::FlagsUsageConfig config;  // --help shows the flags of this file
  config.contains_help_flags = [](absl::string_view file) { return absl::EndsWith(file, "import_main.cc"); };
  absl::SetFlagsUsageConfig(config);
  absl::SetProgramUsageMessage(kUsage);
  const std::vector<char*> arguments = absl::ParseCommandLine(argc, argv);
  if (arguments.size() != 3) return Fail("expected IN.pth and OUT.safetensors; see --help");
  const std::map<std::string, torch::ScalarType> dtypes = {
      {"float32", torch::kFloat32}, {"float16", torch::kFloat16}, {"bfloat16", torch::kBFloat16}};
  const auto dtype = dtypes.find(absl::GetFlag(FLAGS_dtype));
  if (dtype == dtypes.end()) return Fail("--dtype must be float32, float16 or bfloat16");

  holdfast::ImportOptions options;
  options.dtype = dtype->second;
  options.context_heads = absl::GetFlag(FLAGS_context_heads);
  options.context_patch = absl::GetFlag(FLAGS_context_patch);
  options.window = absl::GetFlag(FLAGS_window);
  const std::string out = arguments[2];
  const auto result = holdfast::ImportPth(arguments[1], out, options);
  if (!result.ok()) return Fail(std::string(result.status().message()));
  std::cout << "wrote '" << out << "': " << result->parameters << " parameters as " << dtype->first << ", preset "
            << holdfast::PresetName(result->options) << std::endl;
  return 0;
}
