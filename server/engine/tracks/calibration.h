// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "server/engine/evidence.h"

namespace holdfast {

// How a network's estimates are to be trusted: the probability that an estimate is within 8 pixels (of a frame of
// 256x256) of a point that is visible, by logistic regression on the evidence. Fitted to one checkpoint by
// `holdfast-eval --calibrate` and stored in its metadata.
class Calibration {
 public:
  // Of a checkpoint's metadata.
  static constexpr char kMetadataKey[] = "holdfast.confidence";

  static constexpr size_t kFeatures = 9;
  using Features = std::array<double, kFeatures>;
  // In the order of Features, as they are named in JSON.
  static const std::array<const char*, kFeatures>& FeatureNames();
  // Finite numbers of moderate size, whatever the evidence; one of them is the constant 1.
  static Features FeaturesOf(const Evidence& evidence);

  explicit Calibration(const Features& weights) : weights_(weights) {}
  // {"version": 1, "weights": {name: number, ...}} with exactly the names above; INVALID_ARGUMENT says what is wrong.
  static absl::StatusOr<Calibration> FromJson(absl::string_view json);
  std::string ToJson() const;

  const Features& weights() const { return weights_; }
  // In [0, 1].
  float Confidence(const Evidence& evidence) const;

 private:
  Features weights_;
};

}  // namespace holdfast
