// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "client/cli/track_extent.h"
#include "client/cli/track_table.h"
#include "client/cli/track_writer.h"

namespace holdfast {

// The arrays of TrackFormat::kNpz, each a .npy file, by name.
std::vector<std::pair<std::string, std::string>> TrackArrays(const TrackTable& table, const VideoFacts& video,
                                                             const TrackExtent& extent);

}  // namespace holdfast
