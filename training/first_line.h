// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <exception>
#include <string>

namespace holdfast {

// What an exception says, without the stack trace that LibTorch puts below it.
inline std::string FirstLine(const std::exception& e) {
  const std::string text = e.what();
  return text.substr(0, text.find('\n'));
}

}  // namespace holdfast
