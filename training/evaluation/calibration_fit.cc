// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/calibration_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

constexpr int kFeatures = static_cast<int>(Calibration::kFeatures);
constexpr double kRidge = 1e-4;  // of an estimate's likelihood; keeps weights of what never occurs at 0
constexpr int kMostSteps = 50;
constexpr double kSmallStep = 1e-7;

using Weights = cv::Vec<double, kFeatures>;
using Hessian = cv::Matx<double, kFeatures, kFeatures>;

struct Row {
  Weights features;
  double right = 0;
};

void Append(const Evidence& evidence, bool right, std::vector<Row>& rows) {
  const Calibration::Features features = Calibration::FeaturesOf(evidence);
  rows.push_back({Weights(features.data()), right ? 1.0 : 0.0});
}

std::vector<Row> RowsOf(const std::vector<Judged>& observed) {
  std::vector<Row> rows;
  for (const Judged& judged : observed) {
    Append(judged.evidence, judged.right, rows);
    if (judged.evidence.polish == Evidence::Polish::kNotTried) continue;
    Evidence before = judged.evidence;
    before.polish = Evidence::Polish::kNotTried;
    Append(before, judged.right, rows);
  }
  return rows;
}

// The mean negative logarithm of the likelihood, and the pull.
double Loss(const std::vector<Row>& rows, const Weights& weights) {
  double sum = 0;
  for (const Row& row : rows) {
    const double x = weights.dot(row.features);
    sum += std::max(x, 0.0) - x * row.right + std::log1p(std::exp(-std::abs(x)));
  }
  return sum / static_cast<double>(rows.size()) + kRidge / 2 * weights.dot(weights);
}

// Newton's step from 'weights'.
Weights Step(const std::vector<Row>& rows, const Weights& weights) {
  const double scale = 1 / static_cast<double>(rows.size());
  Weights gradient = weights * kRidge;
  Hessian hessian = Hessian::eye() * kRidge;
  for (const Row& row : rows) {
    const double p = 1 / (1 + std::exp(-weights.dot(row.features)));
    gradient += row.features * ((p - row.right) * scale);
    hessian += (row.features * row.features.t()) * (p * (1 - p) * scale);
  }
  return hessian.solve(gradient, cv::DECOMP_CHOLESKY);
}

}  // namespace

absl::StatusOr<Calibration> FitCalibration(const std::vector<Judged>& observed) {
  const auto right = std::count_if(observed.begin(), observed.end(), [](const Judged& judged) { return judged.right; });
  if (right == 0 || right == static_cast<std::ptrdiff_t>(observed.size())) {
    return absl::FailedPreconditionError(
        absl::StrCat("confidence cannot be calibrated: ", right, " of ", observed.size(), " estimates are right"));
  }
  const std::vector<Row> rows = RowsOf(observed);
  Weights weights = Weights::all(0);
  double loss = Loss(rows, weights);
  for (int i = 0; i < kMostSteps; ++i) {
    Weights step = Step(rows, weights);
    double next = Loss(rows, weights - step);
    while (!(next <= loss) && cv::norm(step) > kSmallStep) {
      step *= 0.5;
      next = Loss(rows, weights - step);
    }
    if (!(next <= loss) || cv::norm(step) <= kSmallStep) break;
    weights -= step;
    loss = next;
  }
  Calibration::Features fitted;
  std::copy(weights.val, weights.val + kFeatures, fitted.begin());
  return Calibration(fitted);
}

}  // namespace holdfast
