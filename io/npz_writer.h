// SPDX-License-Identifier: Apache-2.0
// The files that numpy.load reads.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace holdfast {

// A .npy file, version 1.0. 'dtype' as NumPy writes it ("<f4"), 'data' in C order.
// REQUIRES: data.size() is the size of the array.
std::string NpyFile(absl::string_view dtype, const std::vector<int64_t>& shape, absl::string_view data);

// A compressed .npz: each array under its name.
absl::Status WriteNpz(const std::string& path, const std::vector<std::pair<std::string, std::string>>& npy_files);

}  // namespace holdfast
