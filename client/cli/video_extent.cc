// SPDX-License-Identifier: Apache-2.0
#include "client/cli/video_extent.h"

#include <algorithm>

#include "absl/strings/str_format.h"
#include "client/cli/declared_length.h"

namespace holdfast {
namespace {

constexpr double kGap = 2.5;         // frames' distances, from here on
constexpr int64_t kFramesAGap = 50;  // at least, where gaps are what nobody expects
constexpr double kInexact = 0.1;     // share of a length
constexpr double kInexactSeconds = 1;

}  // namespace

VideoExtent::VideoExtent(std::string input, const DeclaredVideo& facts) : input_(std::move(input)), facts_(facts) {}

void VideoExtent::Passed(std::optional<double> at) {
  if (at && at_ && facts_.fps > 0 && *at - *at_ > kGap / facts_.fps) {
    ++gaps_;
    if (*at - *at_ > gap_seconds_) {
      gap_seconds_ = *at - *at_;
      gap_after_ = passed_ - 1;
    }
  }
  ++passed_;
  if (at) at_ = std::max(at_.value_or(*at), *at);
}

absl::Status VideoExtent::Damaged() {
  ++damages_;
  if (facts_.live) return absl::OkStatus();
  if (LacksItsEnd(input_)) return End();  // by what is left of its last frame
  return absl::DataLossError(absl::StrFormat("%s: is damaged: frame %d cannot be decoded", input_, passed_));
}

absl::Status VideoExtent::End() {
  ended_ = true;
  if (facts_.live || !LacksItsEnd(input_)) return absl::OkStatus();
  if (facts_.frames == 0) {
    return absl::DataLossError(absl::StrFormat("%s: is cut off: it ends after %d frames", input_, passed_));
  }
  // The frames of the first fragment may be all that an MP4 counts.
  const bool fragmented = facts_.counted && passed_ > facts_.frames;
  if (passed_ >= facts_.frames && !fragmented) return absl::OkStatus();
  return absl::DataLossError(
      absl::StrFormat("%s: is cut off: it ends after %d of %d frames", input_, passed_, facts_.frames));
}

// Where most frames come evenly.
bool VideoExtent::HasFewGaps() const { return gaps_ > 0 && gaps_ * kFramesAGap <= passed_; }

std::string VideoExtent::Doubt() const {
  if (damages_ > 0) {
    return absl::StrFormat("%s: is damaged, at %d place%s; pictures were left out there", input_, damages_,
                           damages_ == 1 ? "" : "s");
  }
  if (!ended_) return "";
  if (!failure_.empty()) return absl::StrFormat("%s: ends after %d frames: %s", input_, passed_, failure_);
  if (facts_.live) return "";
  if (facts_.counted && passed_ < facts_.frames) {
    return absl::StrFormat("%s: gave %d of %d frames; is it damaged, or does an edit list leave some out?", input_,
                           passed_, facts_.frames);
  }
  if (HasFewGaps()) {
    return absl::StrFormat("%s: no frame comes for %.1f seconds after frame %d; are some missing?", input_,
                           gap_seconds_, gap_after_);
  }
  const double enough = facts_.seconds - std::max(kInexactSeconds, kInexact * facts_.seconds);
  if (!at_ || *at_ >= enough) return "";
  return absl::StrFormat("%s: its pictures end at %.1f of %.1f seconds; is it damaged, or its sound longer?", input_,
                         *at_, facts_.seconds);
}

}  // namespace holdfast
