// SPDX-License-Identifier: Apache-2.0
#include "training/loss/matching_loss.h"

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
  const int64_t channels = maps.size(1);
  const BilinearCells cells = CellsAround(targets.tracks / static_cast<double>(stride), maps.size(2), maps.size(3));
  const torch::Tensor wide = maps.to(torch::kFloat32);
  const torch::Tensor query = cells.index.select(1, 0);  // [N, 4]
  const torch::Tensor first = wide[0].flatten(1).t();    // [cells, C]
  const torch::Tensor corners = first.index_select(0, query.flatten()).view({query.size(0), 4, channels});
  const torch::Tensor f1 = (corners * cells.weight.select(1, 0).unsqueeze(-1)).sum(1) / std::sqrt(channels);  // [N, C]
  // All dot products as one 1x1 convolution, which is much faster on the CPU than the BLAS behind matmul.
  const torch::Tensor dots = at::conv2d(wide, f1.unsqueeze(2).unsqueeze(3));               // [S, N, H8, W8]
  const torch::Tensor log_share = torch::log_softmax(dots.flatten(2).transpose(1, 2), 1);  // [S, cells, N]
  const torch::Tensor index = cells.index.permute({1, 2, 0}), weight = cells.weight.permute({1, 2, 0});  // [S, 4, N]
  const torch::Tensor entropy = -(log_share.gather(1, index) * weight).sum(1);                           // [S, N]
  const torch::Tensor counts = targets.visible.t();
  return entropy.masked_fill(~counts, 0).sum() / counts.sum().clamp_min(1);
}

}  // namespace holdfast
