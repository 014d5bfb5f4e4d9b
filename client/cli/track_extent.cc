// SPDX-License-Identifier: Apache-2.0
#include "client/cli/track_extent.h"

#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

// The frames begin .. end - 1. REQUIRES: begin < end.
std::string Frames(int64_t begin, int64_t end) {
  return end == begin + 1 ? absl::StrCat(begin) : absl::StrCat(begin, "..", end - 1);
}

std::string Finals(const TrackExtent& extent) {
  if (extent.final_frames == extent.frames) return " (all final)";
  if (extent.final_frames == 0) return " (none final)";
  return absl::StrCat(" (", Frames(0, extent.final_frames), extent.final_frames == 1 ? " is" : " are", " final)");
}

std::string Missing(const TrackExtent& extent) {
  if (extent.expected_frames <= extent.frames) return ", none is missing";
  const bool one = extent.expected_frames == extent.frames + 1;
  return absl::StrCat(", ", Frames(extent.frames, extent.expected_frames), one ? " is missing" : " are missing");
}

}  // namespace

std::string Describe(const TrackExtent& extent) {
  return absl::StrCat(extent.frames == 1 ? "frame " : "frames ", Frames(0, extent.frames), " of ",
                      extent.expected_frames, Finals(extent), Missing(extent));
}

}  // namespace holdfast
