// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <ostream>
#include <string>

#include "api/clock.h"

namespace holdfast {

// Says how far a job is: a bar that is redrawn on a terminal, otherwise a plain line every few seconds. Not
// thread-safe.
class Progress {
 public:
  struct Options {
    bool terminal = false;
    int64_t total = 0;  // frames; 0: not known
    std::function<SteadyTime()> now;
  };

  // 'out' is not owned.
  Progress(Options options, std::ostream& out);
  ~Progress();

  // 'lag': frames sent whose features are not computed yet. Draws only when it is time to.
  void Update(int64_t done, int64_t lag);
  // Something else is written next: ends the line of a terminal's bar, which is drawn anew later on.
  void Interrupt();
  // Draws the last state, unless a log says it already, and ends the line; later updates draw nothing.
  void Close();

 private:
  std::string Line() const;
  void Draw();

  const Options options_;
  std::ostream& out_;
  const SteadyTime start_;
  SteadyTime last_drawn_;
  int64_t done_ = 0;
  int64_t last_done_ = -1;  // as drawn
  int64_t lag_ = 0;
  bool drawn_ = false;  // and the line not ended
  bool closed_ = false;
};

}  // namespace holdfast
