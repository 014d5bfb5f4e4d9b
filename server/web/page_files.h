// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "absl/strings/string_view.h"

namespace holdfast {

// A file that is part of the program.
struct PageFile {
  absl::string_view path;  // as URLs have it: "/index.html"
  absl::string_view bytes;
  absl::string_view etag;       // in quotes; changes with the bytes
  absl::string_view gzip = {};  // the bytes compressed; empty: that would make them hardly fewer
};

// The page of web/dist and the clip that it shows. CMake writes the function: see holdfast_embed.
const std::vector<PageFile>& PageFiles();

}  // namespace holdfast
