// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"
#include "api/types.h"
#include "client/cli/hop_bounds.h"
#include "client/cli/load_session.h"
#include "program/termination.h"

namespace holdfast {

struct LoadOptions {
  std::string input;  // as FrameSource::Open takes it; its first frames are shown over and over
  int sessions = 8;
  int points = 64;  // of each session, spread over the frame
  double fps = 0;   // of each session; 0: as fast as the server takes frames
  absl::Duration duration = absl::Seconds(30);
  absl::Duration ramp;                   // over which the sessions begin, one after the other
  double slow = 0, cancel = 0, bad = 0;  // per cent of the sessions; the others are healthy
  std::string out;                       // .json for the results; empty: none
  int max_side = 0;                      // of the frames sent, pixels; 0: as they are
  int jpeg_quality = 92;
  ImageSize processing_size;  // empty: the server's default
  HopBounds hop;
  double promise_fps = 0;  // that the server is to promise; 0: the pace that it has time for
  bool live = false;       // asks for an estimate on every frame

  absl::Status Validate() const;
};

// Which client is of which kind: the shares of the options, rounded to whole clients.
std::vector<LoadKind> KindsOf(const LoadOptions& options);

struct LoadEnvironment {
  LoadSession::Connect connect;  // a connection of its own for each client
  StopSignal& stop;              // ends the run early, with the results so far
  std::ostream& out;
};

// Runs the clients side by side and prints what they saw. INTERNAL when a healthy one failed. REQUIRES:
// options.Validate() is OK.
absl::Status RunLoad(const LoadOptions& options, const LoadEnvironment& environment);

}  // namespace holdfast
