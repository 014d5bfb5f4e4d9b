// SPDX-License-Identifier: Apache-2.0
#include "client/cli/progress.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace holdfast {
namespace {

constexpr int kBarColumns = 30;
constexpr absl::Duration kRedraw = absl::Milliseconds(100);
constexpr absl::Duration kPlainLine = absl::Seconds(5);

}  // namespace

Progress::Progress(Options options, std::ostream& out)
    : options_(std::move(options)), out_(out), start_(options_.now()), last_drawn_(start_) {}

Progress::~Progress() { Close(); }

void Progress::Update(int64_t done, int64_t lag) {
  if (closed_) return;
  done_ = done;
  lag_ = lag;
  const SteadyTime now = options_.now();
  if (Between(last_drawn_, now) < (options_.terminal ? kRedraw : kPlainLine)) return;
  last_drawn_ = now;
  Draw();
}

void Progress::Interrupt() {
  if (options_.terminal && drawn_) out_ << "\n";
  drawn_ = false;
}

void Progress::Close() {
  if (closed_) return;
  closed_ = true;
  if (options_.terminal || done_ != last_done_) Draw();
  if (options_.terminal) out_ << "\n" << std::flush;
}

std::string Progress::Line() const {
  const double seconds = absl::ToDoubleSeconds(Between(start_, options_.now()));
  const double rate = seconds > 0 ? static_cast<double>(done_) / seconds : 0;
  const std::string total = options_.total > 0 ? absl::StrCat("/", options_.total) : "";
  return absl::StrFormat("%d%s frames  %.1f frames/s  lag %d", done_, total, rate, lag_);
}

void Progress::Draw() {
  last_done_ = done_;
  drawn_ = true;
  if (!options_.terminal) {
    out_ << Line() << "\n" << std::flush;
    return;
  }
  std::string bar;
  if (options_.total > 0) {
    const auto filled = static_cast<size_t>(std::min(done_, options_.total) * kBarColumns / options_.total);
    bar = absl::StrCat("[", std::string(filled, '#'), std::string(kBarColumns - filled, '.'), "] ");
  }
  out_ << "\r" << bar << Line() << "\x1b[K" << std::flush;  // clears what a longer line left
}

}  // namespace holdfast
