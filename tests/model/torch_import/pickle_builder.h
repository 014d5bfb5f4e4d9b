// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace holdfast {

// Writes pickles opcode by opcode, hostile ones too.
class PickleBuilder {
 public:
  PickleBuilder() : bytes_("\x80\x02") {}

  PickleBuilder& Raw(const std::string& opcodes) {
    bytes_ += opcodes;
    return *this;
  }
  PickleBuilder& Int(int32_t n) { return Raw("J").Raw(std::string(reinterpret_cast<const char*>(&n), 4)); }
  PickleBuilder& Long(int64_t n) { return Raw("\x8a\x08").Raw(std::string(reinterpret_cast<const char*>(&n), 8)); }
  PickleBuilder& Text(const std::string& text) {
    const uint32_t size = static_cast<uint32_t>(text.size());
    return Raw("X").Raw(std::string(reinterpret_cast<const char*>(&size), 4)).Raw(text);
  }
  PickleBuilder& Global(const std::string& module, const std::string& name) {
    return Raw("c" + module + "\n" + name + "\n");
  }
  PickleBuilder& Storage(const std::string& type, const std::string& key, int64_t elements) {
    return Raw("(").Text("storage").Global("torch", type).Text(key).Text("cpu").Long(elements).Raw("tQ");
  }
  // A one-dimensional tensor.
  PickleBuilder& Tensor(const std::string& key, int64_t elements, int64_t offset, int64_t size, int64_t stride) {
    Global("torch._utils", "_rebuild_tensor_v2").Raw("(").Storage("FloatStorage", key, elements).Long(offset);
    return Long(size).Raw("\x85").Long(stride).Raw("\x85\x89)tR");
  }
  // Without the protocol and the stop, for use within another pickle.
  std::string body() const { return bytes_.substr(2); }
  std::string Stop() const { return bytes_ + "."; }

 private:
  std::string bytes_;
};

}  // namespace holdfast
