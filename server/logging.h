// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/formatter.h>
#include <spdlog/logger.h>

#include <memory>
#include <string>

#include "server/tracing/trace_context.h"

namespace holdfast {

enum class LogFormat { kText, kJson };

// To standard error.
std::shared_ptr<spdlog::logger> MakeLogger(LogFormat format, const std::string& level);

// A logger like 'log' for the lines of one session. 'label' is text without line breaks.
std::shared_ptr<spdlog::logger> SessionLogger(spdlog::logger& log, const std::string& session_id,
                                              const std::string& label, const TraceContext& trace);

// One JSON object a line: time, level, message, and for sessions' lines session, label, trace_id and span_id.
std::unique_ptr<spdlog::formatter> MakeJsonFormatter();

// One line of text: time, level, session and label where there is one, message.
std::unique_ptr<spdlog::formatter> MakeTextFormatter();

}  // namespace holdfast
