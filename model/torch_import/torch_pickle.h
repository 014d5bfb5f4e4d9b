// SPDX-License-Identifier: Apache-2.0
// What the names and tuples mean that torch.save puts into a pickle.
#pragma once

#include <torch/types.h>

#include <optional>
#include <string>
#include <vector>

#include "model/torch_import/pickle.h"

namespace holdfast {

enum class PickleGlobal {
  kRebuildTensor,
  kRebuildParameter,
  kOrderedDict,
  kStorage,  // a storage type, see PickleStorageType
  kInert,    // stands in optimizer and scheduler states; kept as a name, never called
  kRefused,
};

// 'name' is "module name".
PickleGlobal ClassifyPickleGlobal(const std::string& name);
std::optional<torch::ScalarType> PickleStorageType(const std::string& name);

// ("storage", storage type, key, location, elements)
bool IsStorageId(const PickleValue& id);
// Arguments of a tensor's call: (storage, offset, sizes, strides, ...)
bool IsTensorCall(const std::vector<const PickleValue*>& arguments);

}  // namespace holdfast
