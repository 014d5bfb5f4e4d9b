// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <random>
#include <string>

namespace holdfast {

// Changes 'bytes' the way accidents and attackers do: flipped bits, other digits, pieces cut, doubled and moved. Three
// changes of four fall on the first 'structure' bytes.
inline std::string Mutate(std::string bytes, size_t structure, std::mt19937& random) {
  const auto below = [&](size_t n) { return n == 0 ? 0 : random() % n; };
  for (size_t change = 1 + below(4); change > 0 && !bytes.empty(); --change) {
    const size_t at = below(below(4) == 0 ? bytes.size() : std::min(structure, bytes.size()));
    switch (below(6)) {
      case 0:
        bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(8)));
        break;
      case 1:
        bytes[at] = "0123456789[]{},:\"-e\\"[below(20)];
        break;
      case 2:
        bytes.erase(at, 1 + below(16));
        break;
      case 3:
        bytes.insert(at, bytes.substr(below(bytes.size()), below(64)));
        break;
      case 4:
        bytes.resize(at);
        break;
      default:
        bytes.insert(at, std::to_string(random() * uint64_t{random()}));
        break;
    }
  }
  return bytes;
}

}  // namespace holdfast
