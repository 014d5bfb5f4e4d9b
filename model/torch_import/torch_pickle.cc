// SPDX-License-Identifier: Apache-2.0
#include "model/torch_import/torch_pickle.h"

#include <algorithm>

#include "absl/strings/match.h"
#include "absl/strings/string_view.h"

namespace holdfast {
namespace {

using Kind = PickleValue::Kind;

constexpr size_t kMaxDims = 8;
constexpr size_t kMaxKeyBytes = 64;  // a storage's key is a number in decimal

struct StorageType {
  const char* name;
  torch::ScalarType dtype;
};

constexpr StorageType kStorageTypes[] = {
    {"torch FloatStorage", torch::kFloat32},  {"torch HalfStorage", torch::kFloat16},
    {"torch DoubleStorage", torch::kFloat64}, {"torch BFloat16Storage", torch::kBFloat16},
    {"torch LongStorage", torch::kInt64},     {"torch IntStorage", torch::kInt32},
    {"torch ShortStorage", torch::kInt16},    {"torch CharStorage", torch::kInt8},
    {"torch ByteStorage", torch::kUInt8},     {"torch BoolStorage", torch::kBool},
};

// A one-cycle scheduler's state holds its optimizer and a bound method of itself (a pickled getattr).
constexpr absl::string_view kInertNames[] = {
    "__builtin__ dict", "__builtin__ getattr",     "builtins dict", "builtins getattr",
    "torch Size",       "collections defaultdict", "torch device",
};

bool IsTupleOfIntegers(const PickleValue& value) {
  return value.kind == Kind::kTuple && value.items.size() <= kMaxDims &&
         std::all_of(value.items.begin(), value.items.end(),
                     [](const PickleValue* item) { return item->kind == Kind::kInteger; });
}

}  // namespace

std::optional<torch::ScalarType> PickleStorageType(const std::string& name) {
  for (const StorageType& type : kStorageTypes) {
    if (name == type.name) return type.dtype;
  }
  return std::nullopt;
}

PickleGlobal ClassifyPickleGlobal(const std::string& name) {
  if (name == "torch._utils _rebuild_tensor_v2") return PickleGlobal::kRebuildTensor;
  if (name == "torch._utils _rebuild_parameter") return PickleGlobal::kRebuildParameter;
  if (name == "collections OrderedDict") return PickleGlobal::kOrderedDict;
  if (PickleStorageType(name).has_value()) return PickleGlobal::kStorage;
  for (const absl::string_view inert : kInertNames) {
    if (name == inert) return PickleGlobal::kInert;
  }
  if (absl::StartsWith(name, "torch.optim.")) return PickleGlobal::kInert;
  return PickleGlobal::kRefused;
}

bool IsStorageId(const PickleValue& id) {
  const auto& items = id.items;
  return id.kind == Kind::kTuple && items.size() == 5 && items[0]->kind == Kind::kText && items[0]->text == "storage" &&
         items[1]->kind == Kind::kGlobal && PickleStorageType(items[1]->text).has_value() &&
         items[2]->kind == Kind::kText && items[2]->text.size() <= kMaxKeyBytes && items[4]->kind == Kind::kInteger;
}

bool IsTensorCall(const std::vector<const PickleValue*>& arguments) {
  return arguments.size() >= 4 && arguments[0]->kind == Kind::kStorage && arguments[1]->kind == Kind::kInteger &&
         IsTupleOfIntegers(*arguments[2]) && IsTupleOfIntegers(*arguments[3]) &&
         arguments[2]->items.size() == arguments[3]->items.size();
}

}  // namespace holdfast
