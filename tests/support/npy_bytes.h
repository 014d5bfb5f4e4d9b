// SPDX-License-Identifier: Apache-2.0
// Makes .npy files as NumPy does, for tests of their readers.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace holdfast {

// Magic, version 1.0, and the dictionary padded with spaces to a multiple of 64 bytes, as numpy.save writes it.
inline std::string NpyHeaderBytes(const std::string& dictionary) {
  std::string text = dictionary;
  while ((10 + text.size() + 1) % 64 != 0) text += ' ';
  text += '\n';
  std::string bytes("\x93NUMPY\x01\x00", 8);
  bytes += static_cast<char>(text.size() & 0xFF);
  bytes += static_cast<char>(text.size() >> 8);
  return bytes + text;
}

inline std::string NpyDictionary(const std::string& type, const std::vector<int64_t>& shape) {
  std::string sizes;
  for (size_t i = 0; i < shape.size(); ++i) sizes += (i > 0 ? ", " : "") + std::to_string(shape[i]);
  if (shape.size() == 1) sizes += ",";
  return "{'descr': '" + type + "', 'fortran_order': False, 'shape': (" + sizes + "), }";
}

template <typename T>
std::string NpyBytes(const std::string& type, const std::vector<int64_t>& shape, const std::vector<T>& values) {
  std::string bytes = NpyHeaderBytes(NpyDictionary(type, shape));
  return bytes.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

}  // namespace holdfast
