// SPDX-License-Identifier: Apache-2.0
#include "model/kernels/simd.h"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <string>

namespace holdfast {
namespace {

bool StartsWith(const std::string& text, const char* start) { return text.rfind(start, 0) == 0; }

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
InstructionSet Choose() {
  const InstructionSet most = AllowedInstructionSet(std::getenv("ONEDNN_MAX_CPU_ISA"), std::getenv("DNNL_MAX_CPU_ISA"));
  if (most >= InstructionSet::kAvx512 && __builtin_cpu_supports("x86-64-v4")) return InstructionSet::kAvx512;
  if (most >= InstructionSet::kAvx2 && __builtin_cpu_supports("x86-64-v3")) return InstructionSet::kAvx2;
  return InstructionSet::kBase;
}
#else
InstructionSet Choose() { return InstructionSet::kBase; }
#endif

}  // namespace

InstructionSet AllowedInstructionSet(const char* onednn, const char* dnnl) {
  const auto is_set = [](const char* value) { return value != nullptr && *value != '\0'; };
  std::string most = is_set(onednn) ? onednn : is_set(dnnl) ? dnnl : "";
  std::transform(most.begin(), most.end(), most.begin(), [](unsigned char c) { return std::toupper(c); });
  if (most == "AVX" || StartsWith(most, "SSE")) return InstructionSet::kBase;
  return StartsWith(most, "AVX2") ? InstructionSet::kAvx2 : InstructionSet::kAvx512;
}

InstructionSet KernelInstructionSet() {
  static const InstructionSet chosen = Choose();
  return chosen;
}

}  // namespace holdfast
