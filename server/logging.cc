// SPDX-License-Identifier: Apache-2.0
#include "server/logging.h"

#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_sinks.h>

#include <nlohmann/json.hpp>
#include <tuple>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/time.h"

namespace holdfast {
namespace {

constexpr char kTextPattern[] = "%Y-%m-%dT%H:%M:%S.%e%z %l [%*] %v";  // %*: WhoseLine

std::string ToString(spdlog::string_view_t text) { return std::string(text.data(), text.size()); }

// A message knows its logger by the name alone: "session/label\ntrace_id/span_id" of those of sessions.
std::string NameOf(const std::string& session_id, const std::string& label, const TraceContext& trace) {
  return absl::StrCat(session_id, "/", label, "\n", trace.trace_id, "/", trace.span_id);
}

std::pair<std::string, std::string> SplitAt(const std::string& text, char separator) {
  return absl::StrSplit(text, absl::MaxSplits(separator, 1));
}

// What of a logger's name a line of text shows.
class WhoseLine final : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& msg, const std::tm&, spdlog::memory_buf_t& out) override {
    const std::string shown = SplitAt(ToString(msg.logger_name), '\n').first;
    out.append(shown.data(), shown.data() + shown.size());
  }
  std::unique_ptr<custom_flag_formatter> clone() const override { return std::make_unique<WhoseLine>(); }
};

class JsonFormatter final : public spdlog::formatter {
 public:
  void format(const spdlog::details::log_msg& msg, spdlog::memory_buf_t& out) override {
    nlohmann::ordered_json line;
    line["time"] = absl::FormatTime("%Y-%m-%dT%H:%M:%E6SZ", absl::FromChrono(msg.time), absl::UTCTimeZone());
    line["level"] = ToString(spdlog::level::to_string_view(msg.level));
    const auto [session, trace] = SplitAt(ToString(msg.logger_name), '\n');
    if (!trace.empty()) {
      std::tie(line["session"], line["label"]) = SplitAt(session, '/');
      std::tie(line["trace_id"], line["span_id"]) = SplitAt(trace, '/');
    }
    line["message"] = ToString(msg.payload);
    const std::string text = line.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
    out.append(text.data(), text.data() + text.size());
  }

  std::unique_ptr<spdlog::formatter> clone() const override { return std::make_unique<JsonFormatter>(); }
};

}  // namespace

std::unique_ptr<spdlog::formatter> MakeJsonFormatter() { return std::make_unique<JsonFormatter>(); }

std::unique_ptr<spdlog::formatter> MakeTextFormatter() {
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  formatter->add_flag<WhoseLine>('*').set_pattern(kTextPattern);
  return formatter;
}

std::shared_ptr<spdlog::logger> SessionLogger(spdlog::logger& log, const std::string& session_id,
                                              const std::string& label, const TraceContext& trace) {
  return log.clone(NameOf(session_id, label, trace));
}

std::shared_ptr<spdlog::logger> MakeLogger(LogFormat format, const std::string& level) {
  auto logger = std::make_shared<spdlog::logger>("server", std::make_shared<spdlog::sinks::stderr_sink_mt>());
  logger->set_formatter(format == LogFormat::kJson ? MakeJsonFormatter() : MakeTextFormatter());
  logger->set_level(spdlog::level::from_str(level));
  return logger;
}

}  // namespace holdfast
