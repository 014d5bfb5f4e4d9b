// SPDX-License-Identifier: Apache-2.0
// Shape and dtype checks of public entry points. A failed check is a bug of the caller: it throws c10::Error.
#pragma once

#include <torch/types.h>

#include <initializer_list>

namespace holdfast {

// -1 in 'want' matches any size. The message has the name, the shape and dtype got, and those wanted.
void CheckTensor(const char* name, const torch::Tensor& tensor, std::initializer_list<int64_t> want,
                 torch::ScalarType dtype = torch::kFloat32);
// As above for tensors of any floating-point dtype.
void CheckFloating(const char* name, const torch::Tensor& tensor, std::initializer_list<int64_t> want);

}  // namespace holdfast
