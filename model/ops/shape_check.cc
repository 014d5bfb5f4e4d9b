// SPDX-License-Identifier: Apache-2.0
#include "model/ops/shape_check.h"

#include <sstream>
#include <string>

namespace holdfast {
namespace {

bool ShapeMatches(const torch::Tensor& tensor, std::initializer_list<int64_t> want) {
  if (tensor.dim() != static_cast<int64_t>(want.size())) return false;
  int64_t axis = 0;
  for (const int64_t size : want) {
    if (size != -1 && tensor.size(axis) != size) return false;
    ++axis;
  }
  return true;
}

std::string Got(const torch::Tensor& tensor) {
  if (!tensor.defined()) return "an undefined tensor";
  std::ostringstream text;
  text << tensor.sizes() << " " << tensor.scalar_type();
  return text.str();
}

std::string Want(std::initializer_list<int64_t> want) {
  std::ostringstream text;
  text << "[";
  const char* separator = "";
  for (const int64_t size : want) {
    text << separator;
    size == -1 ? text << "*" : text << size;
    separator = ", ";
  }
  text << "]";
  return text.str();
}

}  // namespace

void CheckTensor(const char* name, const torch::Tensor& tensor, std::initializer_list<int64_t> want,
                 torch::ScalarType dtype) {
  TORCH_CHECK(tensor.defined() && tensor.scalar_type() == dtype && ShapeMatches(tensor, want), name, ": got ",
              Got(tensor), ", wanted ", Want(want), " ", dtype);
}

void CheckFloating(const char* name, const torch::Tensor& tensor, std::initializer_list<int64_t> want) {
  TORCH_CHECK(tensor.defined() && tensor.is_floating_point() && ShapeMatches(tensor, want), name, ": got ", Got(tensor),
              ", wanted ", Want(want), " of a floating-point dtype");
}

}  // namespace holdfast
