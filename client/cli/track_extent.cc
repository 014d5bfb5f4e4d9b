// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_extent.h"

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

using Numbers = std::function<int64_t(int64_t)>;

// The frames begin .. end - 1. REQUIRES: begin < end.
std::string Frames(int64_t begin, int64_t end, const Numbers& number) {
  return end == begin + 1 ? absl::StrCat(number(begin)) : absl::StrCat(number(begin), "..", number(end - 1));
}

std::string Finals(const TrackExtent& extent, const Numbers& number) {
  if (extent.final_frames == extent.frames) return " (all final)";
  if (extent.final_frames == 0) return " (none final)";
  const bool one = extent.final_frames == 1;
  return absl::StrCat(" (", Frames(0, extent.final_frames, number), one ? " is" : " are", " final)");
}

std::string Missing(const TrackExtent& extent, const Numbers& number) {
  if (extent.expected_frames <= extent.frames) return ", none is missing";
  const bool one = extent.expected_frames == extent.frames + 1;
  return absl::StrCat(", ", Frames(extent.frames, extent.expected_frames, number),
                      one ? " is missing" : " are missing");
}

}  // namespace

std::string Describe(const TrackExtent& extent, const std::function<int64_t(int64_t)>& number) {
  const bool all = number(extent.frames - 1) == extent.frames - 1;
  return absl::StrCat(extent.frames == 1 ? "frame " : "frames ", Frames(0, extent.frames, number),
                      all ? "" : absl::StrCat(", ", extent.frames), " of ", extent.expected_frames,
                      Finals(extent, number), Missing(extent, number));
}

}  // namespace holdfast
