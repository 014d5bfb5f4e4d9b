// SPDX-License-Identifier: Apache-2.0
#include "io/bounded_json.h"

#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "io/quoted.h"

namespace holdfast {
namespace {

using Json = nlohmann::json;

// Walks the text without building values; the walk ends at the first thing that is not allowed.
class LimitCheck : public nlohmann::json_sax<Json> {
 public:
  explicit LimitCheck(size_t max_depth) : max_depth_(max_depth) {}

  const std::string& problem() const { return problem_; }

  bool null() override { return true; }
  bool boolean(bool) override { return true; }
  bool number_integer(number_integer_t) override { return true; }
  bool number_unsigned(number_unsigned_t) override { return true; }
  bool number_float(number_float_t, const string_t&) override { return true; }
  bool string(string_t&) override { return true; }
  bool binary(binary_t&) override { return true; }
  bool start_object(std::size_t) override { return Enter(); }
  bool end_object() override { return Leave(); }
  bool start_array(std::size_t) override { return Enter(); }
  bool end_array() override { return Leave(); }

  bool key(string_t& name) override {
    if (keys_.back().insert(name).second) return true;
    problem_ = absl::StrCat("key ", Quoted(name), " stands twice");
    return false;
  }

  bool parse_error(std::size_t position, const std::string&, const nlohmann::detail::exception&) override {
    problem_ = absl::StrCat("syntax error at byte ", position);
    return false;
  }

 private:
  bool Enter() {
    keys_.emplace_back();
    if (keys_.size() <= max_depth_) return true;
    problem_ = absl::StrCat("nested deeper than ", max_depth_);
    return false;
  }

  bool Leave() {
    keys_.pop_back();
    return true;
  }

  const size_t max_depth_;
  std::vector<std::set<std::string>> keys_;  // of each object or array that is open
  std::string problem_;
};

}  // namespace

absl::StatusOr<Json> ParseBoundedJson(absl::string_view text, const JsonLimits& limits) {
  if (text.size() > limits.max_bytes) {
    return absl::InvalidArgumentError(absl::StrCat("JSON of ", text.size(), " bytes; at most ", limits.max_bytes));
  }
  // The library takes a zero byte for the end of the text, whatever follows it.
  if (const size_t zero = text.find('\0'); zero != absl::string_view::npos) {
    return absl::InvalidArgumentError(absl::StrCat("JSON: syntax error at byte ", zero + 1));
  }
  LimitCheck check(limits.max_depth);
  if (!Json::sax_parse(text.begin(), text.end(), &check)) {
    return absl::InvalidArgumentError(absl::StrCat("JSON: ", check.problem()));
  }
  return Json::parse(text.begin(), text.end(), nullptr, /*allow_exceptions=*/false);
}

}  // namespace holdfast
