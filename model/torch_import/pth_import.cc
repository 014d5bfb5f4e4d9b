// SPDX-License-Identifier: Apache-2.0
#include "model/torch_import/pth_import.h"

#include <exception>
#include <numeric>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "model/checkpoint/checkpoint.h"

namespace holdfast {
namespace {

// Reads sizes of parameters; the first fault is kept and every later size is 1.
class Shapes {
 public:
  explicit Shapes(const StateDict& tensors) : tensors_(tensors) {}

  const absl::Status& status() const { return status_; }

  // Size of an axis of a parameter of 'dims' axes.
  int64_t Size(const std::string& name, int64_t dims, int64_t axis) {
    const auto found = tensors_.find(name);
    if (found == tensors_.end())
      return Fail(absl::StrCat("parameter '", name, "' is missing: not a PIPs++ checkpoint"));
    const torch::Tensor& tensor = found->second;
    if (tensor.dim() != dims || tensor.size(axis) < 1) {
      return Fail(absl::StrCat("parameter '", name, "' has shape [", absl::StrJoin(tensor.sizes(), ", "), "]; want ",
                               dims, " axes"));
    }
    return tensor.size(axis);
  }

  bool Has(const std::string& name) const { return tensors_.count(name) > 0; }

  int64_t Fail(const std::string& problem) {
    if (status_.ok()) status_ = absl::InvalidArgumentError(problem);
    return 1;
  }

 private:
  const StateDict& tensors_;
  absl::Status status_;
};

void InferEncoder(Shapes& shapes, ModelOptions& options) {
  for (size_t i = 0; i < options.encoder_channels.size(); ++i) {
    options.encoder_channels[i] = shapes.Size(absl::StrCat("fnet.layer", i + 1, ".0.conv1.weight"), 4, 0);
  }
  options.encoder_mid = shapes.Size("fnet.conv2.weight", 4, 0);
  options.feature_channels = shapes.Size("fnet.conv3.weight", 4, 0);
}

void InferContext(Shapes& shapes, const ImportOptions& import, ModelOptions& options) {
  options.context_patch = import.context_patch;
  options.context_blocks = 0;
  while (shapes.Has(absl::StrCat("context.blocks.", options.context_blocks, ".norm1.weight"))) ++options.context_blocks;
  if (options.context_blocks == 0) {  // heads mean nothing then, but must divide the channels
    options.context_heads = std::gcd(import.context_heads, options.feature_channels);
    return;
  }
  options.context_heads = import.context_heads;
  options.context_mlp_ratio = shapes.Size("context.blocks.0.mlp.fc1.weight", 2, 0) / options.feature_channels;
}

// The inputs beside the motion are 3 templates x levels x (2R+1)^2 offsets; within the bounds of ModelOptions one pair
// of levels and radius at most gives a number.
void InferCorrelation(Shapes& shapes, int64_t inputs, ModelOptions& options) {
  const int64_t correlations = inputs - options.feature_channels - 2;
  for (options.correlation_radius = 1; options.correlation_radius <= 8; ++options.correlation_radius) {
    for (options.correlation_levels = 1; options.correlation_levels <= 6; ++options.correlation_levels) {
      if (options.CorrelationFeatures() == correlations) return;
    }
  }
  shapes.Fail(absl::StrCat("the update block takes ", inputs, " inputs, which no correlation pyramid gives"));
}

void InferUpdate(Shapes& shapes, ModelOptions& options) {
  const std::string first = "delta_block.first_block_conv.conv.weight";
  options.update_base = shapes.Size(first, 3, 0);
  options.visibility_head = shapes.Size("delta_block.dense.weight", 2, 0) == 3;
  const int64_t inputs = shapes.Size(first, 3, 1);
  if (shapes.status().ok()) InferCorrelation(shapes, inputs, options);
}

absl::StatusOr<ImportResult> ImportChecked(const std::string& in, const std::string& out, const ImportOptions& import) {
  auto tensors = ReadTorchStateDict(in);
  if (!tensors.ok()) return tensors.status();
  const auto options = InferModelOptions(*tensors, import);
  if (!options.ok()) return options.status();
  TensorFile file;
  for (auto& [name, tensor] : *tensors) {
    file.tensors[name] = tensor.is_floating_point() ? tensor.to(torch::kFloat32) : std::move(tensor);
  }
  PointModel model(*options);
  if (auto s = CopyParameters(file, *model); !s.ok()) return s;
  if (auto s = SaveModel(out, *model, import.dtype); !s.ok()) return s;
  return ImportResult{*options, model->ParameterCount()};
}

}  // namespace

absl::StatusOr<ModelOptions> InferModelOptions(const StateDict& tensors, const ImportOptions& import) {
  Shapes shapes(tensors);
  ModelOptions options;
  options.window = import.window;
  InferEncoder(shapes, options);
  InferContext(shapes, import, options);
  InferUpdate(shapes, options);
  if (!shapes.status().ok()) return shapes.status();
  if (auto s = options.Validate(); !s.ok()) return s;
  return options;
}

absl::StatusOr<ImportResult> ImportPth(const std::string& in, const std::string& out, const ImportOptions& import) {
  try {
    return ImportChecked(in, out, import);
  } catch (const std::exception& error) {  // LibTorch's and the allocator's
    return absl::ResourceExhaustedError(absl::StrCat("cannot import '", in, "': ", error.what()));
  }
}

}  // namespace holdfast
