// SPDX-License-Identifier: Apache-2.0
#include "model/checkpoint/checkpoint.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <exception>
#include <filesystem>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"
#include "io/quoted.h"

namespace holdfast {
namespace {

constexpr char kOptionsKey[] = "holdfast.model";
constexpr char kNameKey[] = "holdfast.name";
constexpr size_t kMaxNameBytes = 120;
constexpr int64_t kMaxFileBytes = int64_t{2} << 30;

// Names of one kind of fault, the first few of them.
class Names {
 public:
  void Add(absl::string_view name) {
    if (++count_ <= kShown) shown_.push_back(Quoted(name));
  }
  bool empty() const { return count_ == 0; }
  std::string Text(absl::string_view fault) const {
    const size_t more = count_ - shown_.size();
    return absl::StrCat(fault, " ", absl::StrJoin(shown_, ", "), more > 0 ? absl::StrCat(" and ", more, " more") : "");
  }

 private:
  static constexpr size_t kShown = 5;
  size_t count_ = 0;
  std::vector<std::string> shown_;
};

bool IsStorageDtype(torch::ScalarType dtype) {
  return dtype == torch::kFloat32 || dtype == torch::kFloat16 || dtype == torch::kBFloat16;
}

using Parameters = torch::OrderedDict<std::string, torch::Tensor>;

absl::Status CheckNames(const TensorFile& file, const Parameters& parameters) {
  Names missing, unknown;
  for (const auto& parameter : parameters) {
    if (file.tensors.count(parameter.key()) == 0) missing.Add(parameter.key());
  }
  for (const auto& item : file.tensors) {
    if (!parameters.contains(item.first)) unknown.Add(item.first);
  }
  std::vector<std::string> faults;
  if (!missing.empty()) faults.push_back(missing.Text("missing"));
  if (!unknown.empty()) faults.push_back(unknown.Text("unknown"));
  if (faults.empty()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("checkpoint parameters: ", absl::StrJoin(faults, "; ")));
}

absl::Status CheckParameter(const std::string& name, const torch::Tensor& got, const torch::Tensor& want) {
  if (!IsStorageDtype(got.scalar_type())) {
    return absl::InvalidArgumentError(absl::StrCat("checkpoint parameter ", Quoted(name), " is ",
                                                   c10::toString(got.scalar_type()),
                                                   "; want float32, float16 or bfloat16"));
  }
  if (got.sizes() != want.sizes()) {
    return absl::InvalidArgumentError(absl::StrCat("checkpoint parameter ", Quoted(name), " has shape [",
                                                   absl::StrJoin(got.sizes(), ", "), "]; want [",
                                                   absl::StrJoin(want.sizes(), ", "), "]"));
  }
  if (!got.isfinite().all().item<bool>()) {
    return absl::InvalidArgumentError(absl::StrCat("checkpoint parameter ", Quoted(name), " is not finite"));
  }
  return absl::OkStatus();
}

absl::Status CopyChecked(const TensorFile& file, PointModelImpl& model) {
  const torch::NoGradGuard no_grad;
  Parameters parameters = model.named_parameters();
  if (auto s = CheckNames(file, parameters); !s.ok()) return s;
  for (const auto& [name, tensor] : file.tensors) {
    if (auto s = CheckParameter(name, tensor, parameters[name]); !s.ok()) return s;
  }
  for (const auto& [name, tensor] : file.tensors) parameters[name].copy_(tensor);
  return absl::OkStatus();
}

absl::StatusOr<ModelOptions> OptionsOf(const TensorFile& file) {
  const auto found = file.metadata.find(kOptionsKey);
  if (found == file.metadata.end()) {
    return absl::InvalidArgumentError(absl::StrCat("the metadata has no '", kOptionsKey, "'"));
  }
  auto options = ModelOptionsFromJson(found->second);
  if (!options.ok()) return absl::InvalidArgumentError(absl::StrCat(kOptionsKey, ": ", options.status().message()));
  return options;
}

// Before memory is taken for the network. A file that lacks a few parameters passes: CopyParameters will name them.
absl::Status CheckSize(const TensorFile& file, const ModelOptions& options) {
  int64_t elements = 0;
  for (const auto& item : file.tensors) elements += item.second.numel();
  if (options.ParameterCount() / 2 <= elements) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(kOptionsKey, " describes ", options.ParameterCount(),
                                                 " parameters, but the file holds ", elements, " numbers"));
}

// Bytes of the control character that 'text' begins with, one of the first or the second 32; 0: it is another one.
size_t ControlBytes(absl::string_view text) {
  if (absl::ascii_iscntrl(static_cast<unsigned char>(text[0]))) return 1;
  const absl::string_view two = text.substr(0, 2);
  return two >= "\xc2\x80" && two <= "\xc2\x9f" ? 2 : 0;
}

// The beginning of a UTF-8 text, whole characters of it.
absl::string_view Beginning(absl::string_view text, size_t bytes) {
  if (text.size() <= bytes) return text;
  while (bytes > 0 && (static_cast<unsigned char>(text[bytes]) & 0xc0) == 0x80) --bytes;
  return text.substr(0, bytes);
}

// A name that a file or its own name gave, as messages, labels and terminals can carry it: UTF-8 without control
// characters, not long.
std::string CleanName(const std::string& name) {
  using Json = nlohmann::json;
  const std::string utf8 =
      Json::parse(Json(name).dump(-1, ' ', false, Json::error_handler_t::replace)).get<std::string>();
  std::string clean;
  for (absl::string_view rest = Beginning(utf8, kMaxNameBytes); !rest.empty();) {
    const size_t control = ControlBytes(rest);
    clean += control > 0 ? '?' : rest[0];
    rest.remove_prefix(std::max<size_t>(control, 1));
  }
  return clean;
}

absl::StatusOr<LoadedModel> LoadChecked(const std::string& path) {
  const auto bytes = ReadFile(path, kMaxFileBytes);
  if (!bytes.ok()) return bytes.status();
  const auto file = ParseSafetensors(*bytes);
  if (!file.ok()) return file.status();
  const auto options = OptionsOf(*file);
  if (!options.ok()) return options.status();
  if (auto s = CheckSize(*file, *options); !s.ok()) return s;
  const auto named = file->metadata.find(kNameKey);
  const std::string name = named != file->metadata.end() ? named->second : std::filesystem::path(path).stem().string();
  LoadedModel loaded{PointModel(*options), CleanName(name), Sha256Hex(*bytes), file->metadata};
  if (auto s = CopyParameters(*file, *loaded.model); !s.ok()) return s;
  loaded.model->eval();
  return loaded;
}

}  // namespace

absl::StatusOr<LoadedModel> LoadModel(const std::string& path) {
  try {
    auto loaded = LoadChecked(path);
    if (loaded.ok()) return loaded;
    return absl::Status(loaded.status().code(), absl::StrCat("checkpoint '", path, "': ", loaded.status().message()));
  } catch (const std::exception& error) {  // LibTorch's and the allocator's
    return absl::ResourceExhaustedError(absl::StrCat("checkpoint '", path, "': ", error.what()));
  }
}

absl::Status CopyParameters(const TensorFile& file, PointModelImpl& model) {
  try {
    return CopyChecked(file, model);
  } catch (const std::exception& error) {
    return absl::ResourceExhaustedError(absl::StrCat("checkpoint parameters: ", error.what()));
  }
}

absl::Status SaveModel(const std::string& path, const PointModelImpl& model, torch::ScalarType dtype,
                       const std::map<std::string, std::string>& extra) {
  if (!IsStorageDtype(dtype)) {
    return absl::InvalidArgumentError(absl::StrCat("parameters are not stored as ", c10::toString(dtype)));
  }
  try {
    const TensorFile file = ToTensorFile(model, dtype, extra);
    for (const auto& [name, tensor] : file.tensors) {
      if (auto s = CheckParameter(name, tensor, tensor); !s.ok()) return s;
    }
    return WriteSafetensors(path, file);
  } catch (const std::exception& error) {
    return absl::ResourceExhaustedError(absl::StrCat("cannot save '", path, "': ", error.what()));
  }
}

TensorFile ToTensorFile(const PointModelImpl& model, torch::ScalarType dtype,
                        const std::map<std::string, std::string>& extra) {
  TensorFile file;
  file.metadata = extra;
  file.metadata[kOptionsKey] = ModelOptionsToJson(model.options());
  for (const auto& parameter : model.named_parameters()) {
    file.tensors[parameter.key()] = parameter.value().detach().to(torch::kCPU, dtype).contiguous();
  }
  return file;
}

}  // namespace holdfast
