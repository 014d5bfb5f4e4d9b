// SPDX-License-Identifier: Apache-2.0
// holdfast-import IN.pth OUT.safetensors
#include <cstdlib>
#include <iostream>
#include <map>
#include <string>
#include <vector>

#include "absl/flags/flag.h"
#include "model/presets.h"
#include "model/torch_import/pth_import.h"
#include "program/flags.h"

ABSL_FLAG(std::string, dtype, "float32", "storage of the parameters: float32, float16 or bfloat16");
ABSL_FLAG(int64_t, context_heads, 8, "heads of the contextual attention, where the checkpoint has one");
ABSL_FLAG(int64_t, context_patch, 7,
          "side of an attention patch in feature pixels, where the checkpoint has attention");
ABSL_FLAG(int64_t, window, 24, "frames of a window that the network was trained with");

namespace holdfast {
namespace {

constexpr Program kProgram = {
    "holdfast-import",
    "holdfast-import [flags] IN.pth OUT.safetensors\n\n"
    "Converts a published PIPs++ checkpoint (written by torch.save) to safetensors. No code of the file is run.\n"
    "Every flag can also be set by an environment variable, HOLDFAST_DTYPE for --dtype; the command line wins."};

int Fail(absl::string_view problem, int exit_status) {
  std::cerr << "holdfast-import: " << problem << std::endl;
  return exit_status;
}

int Main(const std::vector<std::string>& args) {
  constexpr int kUsageError = 2;
  if (AnswerQuestion(kProgram, args, std::cout)) return EXIT_SUCCESS;
  const absl::Status environment = SetFlagsFromEnvironment("HOLDFAST_", std::getenv);
  if (!environment.ok()) return Fail(environment.message(), kUsageError);
  const absl::StatusOr<std::vector<std::string>> files = ParseFlags(args);
  if (!files.ok()) return Fail(files.status().message(), kUsageError);
  if (files->size() != 2) return Fail("expected IN.pth and OUT.safetensors; see --help", kUsageError);
  const std::map<std::string, torch::ScalarType> dtypes = {
      {"float32", torch::kFloat32}, {"float16", torch::kFloat16}, {"bfloat16", torch::kBFloat16}};
  const auto dtype = dtypes.find(absl::GetFlag(FLAGS_dtype));
  if (dtype == dtypes.end()) return Fail("--dtype must be float32, float16 or bfloat16", kUsageError);

  ImportOptions options;
  options.dtype = dtype->second;
  options.context_heads = absl::GetFlag(FLAGS_context_heads);
  options.context_patch = absl::GetFlag(FLAGS_context_patch);
  options.window = absl::GetFlag(FLAGS_window);
  const auto result = ImportPth(files->front(), files->back(), options);
  if (!result.ok()) return Fail(result.status().message(), EXIT_FAILURE);
  std::cout << "wrote '" << files->back() << "': " << result->parameters << " parameters as " << dtype->first
            << ", preset " << PresetName(result->options) << std::endl;
  return EXIT_SUCCESS;
}

}  // namespace
}  // namespace holdfast

int main(int argc, char** argv) { return holdfast::Main({argv + 1, argv + argc}); }
