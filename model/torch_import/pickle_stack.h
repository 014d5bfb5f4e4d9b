// SPDX-License-Identifier: Apache-2.0
// The two things a pickle machine works on: the bytes to come and the stack of values. Functions return false when
// there is too little of either.
#pragma once

#include <cstdint>
#include <cstring>
#include <vector>

#include "absl/strings/string_view.h"
#include "model/torch_import/pickle.h"

namespace holdfast {

class PickleBytes {
 public:
  explicit PickleBytes(absl::string_view bytes) : rest_(bytes), size_(bytes.size()) {}

  size_t position() const { return size_ - rest_.size(); }

  bool Take(size_t count, absl::string_view& taken) {
    if (count > rest_.size()) return false;
    taken = rest_.substr(0, count);
    rest_.remove_prefix(count);
    return true;
  }

  // Little-endian, 'count' <= 8 bytes.
  bool TakeNumber(size_t count, uint64_t& number) {
    absl::string_view taken;
    if (!Take(count, taken)) return false;
    number = 0;
    std::memcpy(&number, taken.data(), count);
    return true;
  }

  bool TakeLine(absl::string_view& line) {
    const size_t end = rest_.find('\n');
    absl::string_view newline;
    return end != absl::string_view::npos && Take(end, line) && Take(1, newline);
  }

 private:
  absl::string_view rest_;
  size_t size_;
};

// Values below the last mark are out of reach, as in the reference machine.
class PickleStack {
 public:
  void Push(PickleValue* value) { values_.push_back(value); }

  bool Pop(PickleValue*& value) {
    if (values_.size() <= Floor()) return false;
    value = values_.back();
    values_.pop_back();
    return true;
  }

  bool Top(PickleValue*& value) const {
    if (values_.size() <= Floor()) return false;
    value = values_.back();
    return true;
  }

  bool PopMany(size_t count, std::vector<const PickleValue*>& items) {
    if (values_.size() - Floor() < count) return false;
    items.assign(values_.end() - static_cast<std::ptrdiff_t>(count), values_.end());
    values_.resize(values_.size() - count);
    return true;
  }

  void Mark() { marks_.push_back(values_.size()); }

  bool PopToMark(std::vector<const PickleValue*>& items) {
    if (marks_.empty()) return false;
    PopMany(values_.size() - marks_.back(), items);
    marks_.pop_back();
    return true;
  }

  // A mark that lies on top goes before the value under it.
  bool Drop() {
    PickleValue* ignored = nullptr;
    if (marks_.empty() || marks_.back() != values_.size()) return Pop(ignored);
    marks_.pop_back();
    return true;
  }

 private:
  size_t Floor() const { return marks_.empty() ? 0 : marks_.back(); }

  std::vector<PickleValue*> values_;
  std::vector<size_t> marks_;  // sizes of 'values_'
};

}  // namespace holdfast
