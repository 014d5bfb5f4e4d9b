// SPDX-License-Identifier: Apache-2.0
#include "client/cli/info_command.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace holdfast {
namespace {

using nlohmann::ordered_json;

constexpr double kMebi = 1 << 20;

std::string DescribeLoad(const TrackerLoad& load) {
  std::string text = absl::StrFormat("%d sessions, %d points", load.sessions, load.points);
  if (std::isfinite(load.work_budget)) {
    absl::StrAppendFormat(&text, ", %.0f of %.0f point-frames/s promised (a frame counts %.0f)", load.work_promised,
                          load.work_budget, load.frame_work);
  }
  return text;
}

}  // namespace

std::string DescribeServer(const TrackerInfo& info) {
  const SessionLimits& limits = info.limits;
  std::string out;
  const auto line = [&out](absl::string_view name, const std::string& value) {
    absl::StrAppendFormat(&out, "%-12s %s\n", name, value);
  };
  line("model", absl::StrCat(info.model_name, " (preset ", info.preset, ")"));
  line("weights", absl::StrCat("sha256 ", info.weights_sha256));
  line("device", absl::StrCat(info.device, ", ", info.precision));
  line("build", info.build);
  line("processing", absl::StrCat(ToString(info.default_processing_size), " by default"));
  line("windows", absl::StrFormat("%d frames, a new one every %d, %d iterations by default", info.window_frames,
                                  info.default_hop_frames, info.default_iterations));
  line("sessions", absl::StrCat("at most ", info.max_sessions));
  line("load", DescribeLoad(info.load));
  line("session", absl::StrCat("at most ", limits.max_points, " points, ",
                               limits.max_frames == 0 ? "endless" : absl::StrCat(limits.max_frames, " frames")));
  line("frame",
       absl::StrFormat("at most %.1f MiB, %.1f megapixels", static_cast<double>(limits.max_frame_bytes) / kMebi,
                       static_cast<double>(limits.max_frame_pixels) / 1e6));
  return out;
}

std::string ServerAsJson(const TrackerInfo& info) {
  const ordered_json json = {
      {"model_name", info.model_name},
      {"preset", info.preset},
      {"weights_sha256", info.weights_sha256},
      {"precision", info.precision},
      {"device", info.device},
      {"build", info.build},
      {"default_processing_size",
       {{"width", info.default_processing_size.width}, {"height", info.default_processing_size.height}}},
      {"window_frames", info.window_frames},
      {"default_hop_frames", info.default_hop_frames},
      {"default_iterations", info.default_iterations},
      {"default_motion_prior", info.default_motion_prior},
      {"default_polish", info.default_polish},
      {"calibrated_confidence", info.calibrated_confidence},
      {"max_sessions", info.max_sessions},
      {"load",
       {{"sessions", info.load.sessions},
        {"points", info.load.points},
        {"work_promised", info.load.work_promised},
        {"work_budget", info.load.work_budget},  // null: infinite
        {"frame_work", info.load.frame_work}}},
      {"limits",
       {{"max_points", info.limits.max_points},
        {"max_frame_bytes", info.limits.max_frame_bytes},
        {"max_frame_pixels", info.limits.max_frame_pixels},
        {"max_frames", info.limits.max_frames}}}};
  return json.dump(2, ' ', false, ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace holdfast
