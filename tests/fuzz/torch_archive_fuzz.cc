// SPDX-License-Identifier: Apache-2.0
// The reader of torch.save's files. A first byte of 0: the rest is the file. Otherwise the file is made of pieces with
// right checksums, which mutations of a whole file seldom have: the pickle, then the storages "0", "1"...
#include "model/torch_import/torch_archive.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/memory_file.h"
#include "tests/support/stored_zip.h"

namespace holdfast {
namespace {

std::string ArchiveOf(FuzzInput& input) {
  std::vector<std::pair<std::string, std::string>> entries;
  entries.emplace_back("a/data.pkl", input.TakePiece().value_or(""));
  while (const auto storage = input.TakePiece()) {
    entries.emplace_back(absl::StrCat("a/data/", entries.size() - 1), *storage);
  }
  return StoredZip(entries);
}

}  // namespace
}  // namespace holdfast

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  holdfast::FuzzInput input(data, size);
  const bool whole = input.TakeByte() == 0;
  const holdfast::MemoryFile file(whole ? std::string(input.TakeRest()) : holdfast::ArchiveOf(input));
  const auto tensors = holdfast::ReadTorchStateDict(file.path());
  if (!tensors.ok()) return 0;
  for (const auto& [name, tensor] : *tensors) EXPECT_TRUE(tensor.is_contiguous());
  return 0;
}
