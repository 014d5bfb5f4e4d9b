// SPDX-License-Identifier: Apache-2.0
#include "server/engine/tracks/feature_cache.h"

#include <utility>

namespace holdfast {

void FeatureCache::Push(FrameFeaturesPtr features) {
  bytes_ += features->bytes();
  frames_.push_back(std::move(features));
}

void FeatureCache::EvictBefore(int64_t frame) {
  while (oldest_ < frame && !frames_.empty()) {
    bytes_ -= frames_.front()->bytes();
    frames_.pop_front();
    ++oldest_;
  }
}

}  // namespace holdfast
