// SPDX-License-Identifier: Apache-2.0
// The reader of NumPy's arrays. A first byte of 0: the rest is the .npz file. Otherwise the rest is a .npy file, which
// is packed with the right checksum. The second byte chooses the rows that are read of the array "a".
#include "io/npz_reader.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

#include "tests/fuzz/fuzz_input.h"
#include "tests/support/memory_file.h"
#include "tests/support/stored_zip.h"

namespace holdfast {
namespace {

void Read(const std::string& bytes, uint8_t wanted) {
  const MemoryFile file(bytes);
  const absl::StatusOr<NpzFile> npz = NpzFile::Open(file.path());
  if (!npz.ok() || !npz->Has("a")) return;
  std::vector<int64_t> rows;
  for (int bit = 0; bit < 8; ++bit) {
    if ((wanted >> bit & 1) != 0) rows.push_back(bit);
  }
  const absl::StatusOr<NpyRows> read = npz->ReadRows("a", rows);
  if (!read.ok()) return;
  const NpyHeader header = *npz->Header("a");
  EXPECT_EQ(read->shape, header.shape);
  EXPECT_EQ(read->values.size() * static_cast<size_t>(header.shape.at(0)),
            rows.size() * static_cast<size_t>(header.values()));
}

}  // namespace
}  // namespace holdfast

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  holdfast::FuzzInput input(data, size);
  const bool whole = input.TakeByte() == 0;
  const uint8_t rows = input.TakeByte();
  const std::string bytes(input.TakeRest());
  holdfast::Read(whole ? bytes : holdfast::StoredZip({{"a.npy", bytes}}), rows);
  return 0;
}
