// SPDX-License-Identifier: Apache-2.0
#include "training/matching_loss.h"

#include <cmath>

namespace holdfast {

BilinearCells CellsAround(const torch::Tensor& positions, int64_t height, int64_t width) {
  const torch::Tensor x = positions.select(-1, 0).clamp(0, width - 1);
  const torch::Tensor y = positions.select(-1, 1).clamp(0, height - 1);
  const torch::Tensor left = x.floor().clamp_max(width > 1 ? width - 2 : 0);
  const torch::Tensor top = y.floor().clamp_max(height > 1 ? height - 2 : 0);
  const torch::Tensor dx = x - left, dy = y - top;
  const torch::Tensor corner = (top * width + left).to(torch::kLong);
  const int64_t right = width > 1 ? 1 : 0, below = height > 1 ? width : 0;
  return {torch::stack({corner, corner + right, corner + below, corner + below + right}, -1),
          torch::stack({(1 - dx) * (1 - dy), dx * (1 - dy), (1 - dx) * dy, dx * dy}, -1)};
}

torch::Tensor MatchingLoss(const torch::Tensor& maps, const ClipTargets& targets, int64_t stride) {
  const int64_t frames = maps.size(0), channels = maps.size(1);
  const BilinearCells cells = CellsAround(targets.tracks / static_cast<double>(stride), maps.size(2), maps.size(3));
  // [S, cells, C]: a view of channels-last maps
  const torch::Tensor tokens = maps.permute({0, 2, 3, 1}).reshape({frames, -1, channels}).to(torch::kFloat32);
  const torch::Tensor query = cells.index.select(1, 0);  // [N, 4]
  const torch::Tensor corners = tokens[0].index_select(0, query.flatten()).view({query.size(0), 4, channels});
  const torch::Tensor f1 = (corners * cells.weight.select(1, 0).unsqueeze(-1)).sum(1) / std::sqrt(channels);
  const torch::Tensor log_share = torch::log_softmax(torch::matmul(f1, tokens.transpose(1, 2)), -1);  // [S, N, cells]
  const torch::Tensor index = cells.index.transpose(0, 1), weight = cells.weight.transpose(0, 1);     // [S, N, 4]
  const torch::Tensor entropy = -(log_share.gather(-1, index) * weight).sum(-1);
  const torch::Tensor counts = targets.visible.t();
  return entropy.masked_fill(~counts, 0).sum() / counts.sum().clamp_min(1);
}

}  // namespace holdfast
