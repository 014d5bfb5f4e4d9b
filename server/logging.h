// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/formatter.h>
#include <spdlog/logger.h>

#include <memory>
#include <string>

#include "server/options.h"

namespace holdfast {

// To standard error. The name of a logger that was cloned from it says whose lines these are: "session id/label".
std::shared_ptr<spdlog::logger> MakeLogger(LogFormat format, const std::string& level);

// One JSON object a line: time, level, message, and for sessions' lines session and label.
std::unique_ptr<spdlog::formatter> MakeJsonFormatter();

}  // namespace holdfast
