// SPDX-License-Identifier: Apache-2.0
#include "model/kernels/simd.h"

#include <cstdlib>
#include <string>

namespace holdfast {
namespace {

#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
bool StartsWith(const std::string& text, const char* start) { return text.rfind(start, 0) == 0; }

InstructionSet Choose() {
  const char* variable = std::getenv("DNNL_MAX_CPU_ISA");
  const std::string most = variable == nullptr ? "" : variable;
  if (most == "AVX" || StartsWith(most, "SSE")) return InstructionSet::kBase;
  if (__builtin_cpu_supports("x86-64-v4") && !StartsWith(most, "AVX2")) return InstructionSet::kAvx512;
  if (__builtin_cpu_supports("x86-64-v3")) return InstructionSet::kAvx2;
  return InstructionSet::kBase;
}
#else
InstructionSet Choose() { return InstructionSet::kBase; }
#endif

}  // namespace

InstructionSet KernelInstructionSet() {
  static const InstructionSet chosen = Choose();
  return chosen;
}

}  // namespace holdfast
