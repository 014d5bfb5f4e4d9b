// SPDX-License-Identifier: Apache-2.0
#include "io/npy_header.h"

#include <algorithm>
#include <string>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "io/quoted.h"

namespace holdfast {
namespace {

constexpr int64_t kMaxValues = int64_t{1} << 40;  // of an array in a file
constexpr size_t kMaxAxes = 8;
constexpr size_t kPrefixBytes = 10;  // magic, version and the short form of the length

// A reader of the header's text, which is a Python dictionary of three known keys.
class HeaderText {
 public:
  explicit HeaderText(absl::string_view text) : rest_(text) {}

  bool Take(char wanted) {
    SkipSpace();
    if (rest_.empty() || rest_[0] != wanted) return false;
    rest_.remove_prefix(1);
    return true;
  }
  bool TakeWord(absl::string_view word) {
    SkipSpace();
    return absl::ConsumePrefix(&rest_, word);
  }
  absl::StatusOr<std::string> TakeQuoted() {
    SkipSpace();
    if (rest_.empty() || (rest_[0] != '\'' && rest_[0] != '"'))
      return DamagedArray("a string is missing in the header");
    const size_t end = rest_.find(rest_[0], 1);
    if (end == absl::string_view::npos) return DamagedArray("a string of the header has no end");
    std::string text(rest_.substr(1, end - 1));
    rest_.remove_prefix(end + 1);
    return text;
  }
  absl::StatusOr<int64_t> TakeNumber() {
    SkipSpace();
    size_t digits = 0;
    while (digits < rest_.size() && rest_[digits] >= '0' && rest_[digits] <= '9') ++digits;
    int64_t number = 0;
    if (!absl::SimpleAtoi(rest_.substr(0, digits), &number))
      return DamagedArray("a size in the header is not a number");
    rest_.remove_prefix(digits);
    return number;
  }
  bool AtEnd() {
    SkipSpace();
    return rest_.empty();
  }

 private:
  void SkipSpace() {
    while (!rest_.empty() && (rest_[0] == ' ' || rest_[0] == '\n' || rest_[0] == '\t')) rest_.remove_prefix(1);
  }
  absl::string_view rest_;
};

absl::Status ParseType(const std::string& type, NpyHeader& header) {
  const bool known = type.size() == 3 && type[2] >= '1' && type[2] <= '8' &&
                     absl::StrContains("<|=", type.substr(0, 1)) && absl::StrContains("fiub", type.substr(1, 1));
  const int bytes = known ? type[2] - '0' : 0;
  const bool sized = bytes == 1 || bytes == 2 || bytes == 4 || bytes == 8;
  const bool fits = known && ((type[1] == 'b' && bytes == 1) || (type[1] == 'f' && bytes >= 2) ||
                              ((type[1] == 'i' || type[1] == 'u') && sized));
  if (!fits || (type[1] == 'f' && !sized)) {
    return absl::UnimplementedError(absl::StrCat("arrays of type ", Quoted(type), " are not read"));
  }
  header.kind = type[1];
  header.item_bytes = bytes;
  return absl::OkStatus();
}

absl::Status ParseShape(HeaderText& text, NpyHeader& header) {
  if (!text.Take('(')) return DamagedArray("the shape is not a tuple");
  int64_t values = 1;
  while (!text.Take(')')) {
    absl::StatusOr<int64_t> size = text.TakeNumber();
    if (!size.ok()) return size.status();
    if (header.shape.size() == kMaxAxes) return DamagedArray("too many axes");
    if (*size > 0 && values > kMaxValues / *size) return DamagedArray("the shape is too large");
    values *= std::max<int64_t>(*size, 1);
    header.shape.push_back(*size);
    if (text.Take(')')) break;
    if (!text.Take(',')) return DamagedArray("the shape has no end");
  }
  return absl::OkStatus();
}

absl::Status ParseKey(const std::string& key, HeaderText& text, NpyHeader& header) {
  if (key == "descr") {
    if (text.Take('[') || text.Take('(')) return absl::UnimplementedError("arrays of structures are not read");
    absl::StatusOr<std::string> type = text.TakeQuoted();
    if (!type.ok()) return type.status();
    return ParseType(*type, header);
  }
  if (key == "fortran_order") {
    if (text.TakeWord("True")) return absl::UnimplementedError("column-major arrays are not read");
    return text.TakeWord("False") ? absl::OkStatus() : DamagedArray("fortran_order is not a truth value");
  }
  if (key == "shape") return ParseShape(text, header);
  return DamagedArray("an unknown key in the header");
}

absl::StatusOr<NpyHeader> ParseDictionary(absl::string_view dictionary) {
  HeaderText text(dictionary);
  NpyHeader header;
  std::vector<std::string> seen;
  if (!text.Take('{')) return DamagedArray("the header is not a dictionary");
  while (!text.Take('}')) {
    absl::StatusOr<std::string> key = text.TakeQuoted();
    if (!key.ok()) return key.status();
    if (std::count(seen.begin(), seen.end(), *key) != 0 || !text.Take(':'))
      return DamagedArray("the header is malformed");
    if (absl::Status status = ParseKey(*key, text, header); !status.ok()) return status;
    seen.push_back(*key);
    text.Take(',');
  }
  if (seen.size() != 3 || !text.AtEnd()) return DamagedArray("the header is malformed");
  return header;
}

}  // namespace

absl::Status DamagedArray(absl::string_view what) {
  return absl::DataLossError(absl::StrCat("not a valid array: ", what));
}

int64_t NpyHeader::values() const {
  int64_t product = 1;
  for (const int64_t size : shape) product *= size;
  return product;
}

absl::StatusOr<NpyHeader> ParseNpyHeader(absl::string_view bytes, size_t* header_bytes) {
  if (bytes.size() < kPrefixBytes || !absl::StartsWith(bytes, "\x93NUMPY")) return DamagedArray("no NumPy header");
  const auto byte = [&bytes](size_t i) { return static_cast<size_t>(static_cast<uint8_t>(bytes[i])); };
  const size_t version = byte(6);
  if (version < 1 || version > 3) return DamagedArray("unknown version");
  const size_t start = version == 1 ? 10 : 12;
  if (bytes.size() < start) return DamagedArray("the header is cut short");
  const size_t length = byte(8) + (byte(9) << 8) + (version == 1 ? 0 : (byte(10) << 16) + (byte(11) << 24));
  if (length > kMaxNpyHeaderBytes || start + length > bytes.size())
    return DamagedArray("the header is too long or cut short");
  *header_bytes = start + length;
  return ParseDictionary(bytes.substr(start, length));
}

}  // namespace holdfast
