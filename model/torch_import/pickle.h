// SPDX-License-Identifier: Apache-2.0
// Reads the values out of a pickle as torch.save writes it (protocol 2). Nothing is ever called or imported: a pickled
// call to anything but torch's tensor functions and OrderedDict becomes an inert value. Names outside a short list are
// refused, so that a file which wants to run code is seen as what it is.
#pragma once

#include <torch/types.h>

#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace holdfast {

struct PickleValue {
  enum class Kind {
    kInteger,  // integer; truth values too
    kText,     // text
    kTuple,    // items
    kList,     // items
    kDict,     // items: key, value, key, value...
    kGlobal,   // text: "module name"
    kStorage,  // text: its key in the archive; integer: elements; dtype
    kTensor,   // items: storage, offset (integer), sizes and strides (tuples of as many integers)
    kOther,    // none, floating-point numbers and inert objects
  };
  Kind kind = Kind::kOther;
  torch::ScalarType dtype = torch::kFloat32;
  int64_t integer = 0;
  std::string text;
  std::vector<const PickleValue*> items;  // owned by the document; may form cycles in a hostile file
};

// Owns every value of a pickle.
struct PickleDocument {
  std::deque<PickleValue> values;
  const PickleValue* root = nullptr;
};

// INVALID_ARGUMENT: names the global that is not allowed, the opcode that is not known, or what else is wrong and
// where. Memory is bounded: more than 8 MiB or a million values are refused.
absl::StatusOr<std::unique_ptr<PickleDocument>> ReadPickle(absl::string_view bytes);

}  // namespace holdfast
