// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/reliability.h"

#include <algorithm>
#include <cmath>

namespace holdfast {
namespace {

size_t BinOf(float confidence, size_t bins) {
  const auto bin = static_cast<int64_t>(confidence * static_cast<float>(bins));
  return static_cast<size_t>(std::clamp<int64_t>(bin, 0, static_cast<int64_t>(bins) - 1));
}

// The rank-sum statistic; claims of equal confidence share their mean rank.
std::optional<double> AreaUnderRoc(std::vector<Claim> claims) {
  std::sort(claims.begin(), claims.end(), [](const Claim& a, const Claim& b) { return a.confidence < b.confidence; });
  double rank_sum = 0, right = 0;
  for (size_t begin = 0, end; begin < claims.size(); begin = end) {
    for (end = begin; end < claims.size() && claims[end].confidence == claims[begin].confidence;) ++end;
    const double rank = static_cast<double>(begin + 1 + end) / 2;
    const auto tied = std::count_if(claims.begin() + static_cast<std::ptrdiff_t>(begin),
                                    claims.begin() + static_cast<std::ptrdiff_t>(end),
                                    [](const Claim& claim) { return claim.right; });
    rank_sum += rank * static_cast<double>(tied);
    right += static_cast<double>(tied);
  }
  const double wrong = static_cast<double>(claims.size()) - right;
  if (right == 0 || wrong == 0) return std::nullopt;
  return (rank_sum - right * (right + 1) / 2) / (right * wrong);
}

}  // namespace

std::vector<Claim> ClaimsOf(const ScoredVideo& video) {
  std::vector<Claim> claims;
  if (video.confidence.empty()) return claims;
  for (int64_t point = 0; point < video.points; ++point) {
    for (int64_t frame = video.query_frames[point] + 1; frame < video.frames; ++frame) {
      const int64_t index = video.Index(frame, point);
      const bool placed = video.valid[index] != 0;
      if (!placed && (video.hidden.empty() || video.hidden[index] == 0)) continue;
      const bool right = placed && video.true_visible[index] != 0 && ScoredError(video, index) < kRightWithin;
      claims.push_back({index, video.confidence[index], right});
    }
  }
  return claims;
}

std::optional<Reliability> ComputeReliability(const std::vector<Claim>& claims) {
  if (claims.empty()) return std::nullopt;
  Reliability result;
  result.claims = static_cast<int64_t>(claims.size());
  const auto all = static_cast<double>(claims.size());
  for (const Claim& claim : claims) {
    const double right = claim.right ? 1 : 0, confidence = claim.confidence;
    result.brier += (confidence - right) * (confidence - right) / all;
    ReliabilityBin& bin = result.bins[BinOf(claim.confidence, result.bins.size())];
    ++bin.claims;
    bin.confidence += confidence;
    bin.right += right;
  }
  for (ReliabilityBin& bin : result.bins) {
    if (bin.claims == 0) continue;
    result.ece += std::abs(bin.confidence - bin.right) / all;
    bin.confidence /= static_cast<double>(bin.claims);
    bin.right /= static_cast<double>(bin.claims);
  }
  result.auc = AreaUnderRoc(claims);
  return result;
}

}  // namespace holdfast
