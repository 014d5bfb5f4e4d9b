// SPDX-License-Identifier: Apache-2.0
#include "server/options.h"

#include <spdlog/common.h>

#include <initializer_list>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "api/address.h"
#include "api/types.h"
#include "server/web/host_check.h"

namespace holdfast {
namespace {

constexpr absl::Duration kMostGrace = absl::Hours(24 * 365);  // clients are told what is left of it

absl::Status NoAddress(absl::string_view name, absl::string_view value) {
  return absl::InvalidArgumentError(absl::StrCat(name, " is '", value, "', expected host:port"));
}

absl::Status NoOrigin(absl::string_view value) {
  return absl::InvalidArgumentError(absl::StrCat(
      "web_origins has '", value, "', expected an origin as browsers name it: https://tracks.example, or with a port ",
      "that is not the scheme's own, https://tracks.example:8443; in small letters, and without a path"));
}

bool IsLogLevel(const std::string& level) {
  return level == "off" || spdlog::level::from_str(level) != spdlog::level::off;
}

}  // namespace

absl::Status ServerOptions::Validate() const {
  const std::initializer_list<std::pair<absl::string_view, absl::Duration>> durations = {
      {"first_message_timeout", first_message_timeout},
      {"idle_timeout", idle_timeout},
      {"checkpoint_max_age", checkpoint_max_age},
      {"keepalive_time", keepalive_time},
      {"max_connection_age", max_connection_age}};
  for (const auto& [name, duration] : durations) {
    if (duration < absl::Milliseconds(1)) {
      return absl::InvalidArgumentError(
          absl::StrCat(name, " is ", absl::FormatDuration(duration), ", expected a positive duration or inf"));
    }
  }
  if (grace_period < absl::ZeroDuration() || grace_period > kMostGrace) {
    return absl::InvalidArgumentError(absl::StrCat("grace_period is ", absl::FormatDuration(grace_period),
                                                   ", expected 0 .. ", absl::FormatDuration(kMostGrace)));
  }
  if (absl::Status status = tls.Validate(); !status.ok()) return status;
  // gRPC would listen on a socket of the file system too, but that has no port to tell who looks for the server.
  if (!SplitHostPort(listen) || absl::StartsWith(listen, "unix:")) return NoAddress("listen", listen);
  if (!SplitHostPort(metrics_listen)) return NoAddress("metrics_listen", metrics_listen);
  if (!web_listen.empty() && !SplitHostPort(web_listen)) return NoAddress("web_listen", web_listen);
  for (const std::string& origin : web_origins) {
    if (!IsOrigin(origin)) return NoOrigin(origin);
  }
  if (engine.limits.max_points > kMaxPointsInMessage) {
    return absl::InvalidArgumentError(absl::StrCat("max_points is ", engine.limits.max_points, ", expected at most ",
                                                   kMaxPointsInMessage, ", the most of one message"));
  }
  if (absl::Status status = engine.Validate(); !status.ok()) return status;
  if (engine.weights_path.empty()) return absl::InvalidArgumentError("weights is empty, expected a path");
  if (!IsLogLevel(log_level)) {
    return absl::InvalidArgumentError(
        absl::StrCat("log_level is '", log_level, "', expected trace, debug, info, warning, error, critical or off"));
  }
  return absl::OkStatus();
}

}  // namespace holdfast
