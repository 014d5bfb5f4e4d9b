// SPDX-License-Identifier: Apache-2.0
// Named tensors <-> a network. A checkpoint describes itself: its metadata holds the model options.
#pragma once

#include <map>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "model/checkpoint/safetensors.h"
#include "model/point_model.h"

namespace holdfast {

struct LoadedModel {
  PointModel model;                             // float32, CPU, eval mode
  std::string name;                             // metadata "holdfast.name", or the file's stem; see LoadModel
  std::string sha256;                           // of the file, hex
  std::map<std::string, std::string> metadata;  // all of it
};

// Reads a checkpoint and builds the network it describes. Missing, unknown or misshapen parameters are
// INVALID_ARGUMENT naming them; F16 and BF16 storage is widened to float32. The name is made fit for
// messages and labels: UTF-8 without control characters, at most 120 bytes.
absl::StatusOr<LoadedModel> LoadModel(const std::string& path);
// Copies 'file's tensors into an existing network of the same options.
absl::Status CopyParameters(const TensorFile& file, PointModelImpl& model);
// 'dtype': kFloat32, kFloat16 or kBFloat16 storage. 'extra' joins the metadata.
absl::Status SaveModel(const std::string& path, const PointModelImpl& model, torch::ScalarType dtype = torch::kFloat32,
                       const std::map<std::string, std::string>& extra = {});
TensorFile ToTensorFile(const PointModelImpl& model, torch::ScalarType dtype,
                        const std::map<std::string, std::string>& extra);

}  // namespace holdfast
