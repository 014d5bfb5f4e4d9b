// SPDX-License-Identifier: Apache-2.0
// Arrays of NumPy's .npz files. Everything in the file is checked: what is damaged or hostile gives an error.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "io/npy_header.h"

namespace holdfast {

struct NpyRows {
  std::vector<int64_t> shape;  // of the array in the file
  std::vector<float> values;   // of the rows asked for, in that order; all types become float
};

// An .npz file. Holds no handle between calls; thread-safe.
class NpzFile {
 public:
  // Reads the headers; members that are no .npy are passed over. NOT_FOUND, or DATA_LOSS with the path.
  static absl::StatusOr<NpzFile> Open(const std::string& path);

  // Whether there is such an array and of a kind that is read.
  bool Has(absl::string_view name) const;
  // NOT_FOUND and UNIMPLEMENTED, for arrays of other kinds, name the array.
  absl::StatusOr<NpyHeader> Header(absl::string_view name) const;
  // Rows (indices along the first axis, strictly increasing) of an array, which is unpacked as a stream: memory is
  // taken for the rows alone.
  absl::StatusOr<NpyRows> ReadRows(absl::string_view name, const std::vector<int64_t>& rows) const;

 private:
  struct Entry {
    std::string name;
    absl::StatusOr<NpyHeader> header;  // UNIMPLEMENTED is no fault as long as nobody asks for the array
    size_t header_bytes;
  };
  explicit NpzFile(std::string path) : path_(std::move(path)) {}
  const Entry* Find(absl::string_view name) const;

  std::string path_;
  std::vector<Entry> entries_;
};

}  // namespace holdfast
