// SPDX-License-Identifier: Apache-2.0
#include "model/options.h"

#include <limits>
#include <numeric>
#include <vector>

#include "absl/strings/str_cat.h"
#include "io/bounded_json.h"
#include "io/quoted.h"

namespace holdfast {
namespace {

using Json = nlohmann::ordered_json;

struct IntField {
  const char* key;
  int64_t ModelOptions::*member;
  int64_t min;
  int64_t max;
};

constexpr int64_t kMaxChannels = 4096;
constexpr int64_t kMaxParameters = int64_t{1} << 28;
constexpr char kEncoderChannels[] = "encoder_channels";
constexpr char kVisibilityHead[] = "visibility_head";

// Every field but the two that are not plain integers. Eight feature channels give the motion embedding two
// frequencies, the fewest that its formula knows.
constexpr IntField kIntFields[] = {
    {"encoder_mid", &ModelOptions::encoder_mid, 1, kMaxChannels},
    {"feature_channels", &ModelOptions::feature_channels, 8, kMaxChannels},
    {"stride", &ModelOptions::stride, 8, 8},
    {"context_blocks", &ModelOptions::context_blocks, 0, 64},
    {"context_heads", &ModelOptions::context_heads, 1, 64},
    {"context_mlp_ratio", &ModelOptions::context_mlp_ratio, 1, 16},
    {"context_patch", &ModelOptions::context_patch, 1, 31},
    {"correlation_levels", &ModelOptions::correlation_levels, 1, 6},
    {"correlation_radius", &ModelOptions::correlation_radius, 1, 8},
    {"update_base", &ModelOptions::update_base, 1, kMaxChannels},
    {"window", &ModelOptions::window, 2, 256},
};

absl::Status CheckRange(absl::string_view key, int64_t value, int64_t min, int64_t max) {
  if (value >= min && value <= max) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(key, " is ", value, "; must be in [", min, ", ", max, "]"));
}

// Weight and bias of a convolution or linear layer with 'taps' weights a channel pair.
int64_t Layer(int64_t in, int64_t out, int64_t taps) { return in * out * taps + out; }

int64_t EncoderParameters(const ModelOptions& o) {
  const auto& channels = o.encoder_channels;
  int64_t count = Layer(3, channels[0], 49);
  int64_t in = channels[0];
  for (size_t i = 0; i < channels.size(); ++i) {
    const int64_t out = channels[i];
    count += Layer(in, out, 9) + 3 * Layer(out, out, 9) + (i == 0 ? 0 : Layer(in, out, 1));
    in = out;
  }
  const int64_t stacked = std::accumulate(channels.begin(), channels.end(), int64_t{0});
  return count + Layer(stacked, o.encoder_mid, 9) + Layer(o.encoder_mid, o.feature_channels, 1);
}

int64_t ContextParameters(const ModelOptions& o) {
  if (o.context_blocks == 0) return 0;
  const int64_t c = o.feature_channels;
  const int64_t hidden = c * o.context_mlp_ratio;
  const int64_t norm = 2 * c;
  return o.context_blocks * (2 * norm + 3 * Layer(c, c, 1) + Layer(c, hidden, 1) + Layer(hidden, c, 1)) + norm;
}

int64_t UpdateParameters(const ModelOptions& o) {
  int64_t count = Layer(o.CorrelationFeatures() + o.feature_channels + 2, o.update_base, 3);
  int64_t in = o.update_base;
  for (int64_t stage = 0; stage < 4; ++stage) {  // two blocks a stage, two convolutions a block
    const int64_t out = o.update_base << stage;
    count += Layer(in, out, 3) + 3 * Layer(out, out, 3);
    in = out;
  }
  return count + Layer(in, o.visibility_head ? 3 : 2, 1);
}

absl::StatusOr<int64_t> ToInteger(absl::string_view key, const nlohmann::json& value) {
  const bool too_large =
      value.is_number_unsigned() && value.get<uint64_t>() > static_cast<uint64_t>(std::numeric_limits<int64_t>::max());
  if (!value.is_number_integer() || too_large) {
    return absl::InvalidArgumentError(absl::StrCat(key, ": expected an integer"));
  }
  return value.get<int64_t>();
}

absl::Status ReadChannels(const nlohmann::json& value, std::array<int64_t, 4>& channels) {
  if (!value.is_array() || value.size() != channels.size()) {
    return absl::InvalidArgumentError(absl::StrCat(kEncoderChannels, ": expected a list of four integers"));
  }
  for (size_t i = 0; i < channels.size(); ++i) {
    const auto channel = ToInteger(kEncoderChannels, value[i]);
    if (!channel.ok()) return channel.status();
    channels[i] = *channel;
  }
  return absl::OkStatus();
}

absl::Status ReadField(const std::string& key, const nlohmann::json& value, ModelOptions& options) {
  if (key == kEncoderChannels) return ReadChannels(value, options.encoder_channels);
  if (key == kVisibilityHead) {
    if (!value.is_boolean()) return absl::InvalidArgumentError(absl::StrCat(key, ": expected true or false"));
    options.visibility_head = value.get<bool>();
    return absl::OkStatus();
  }
  for (const IntField& field : kIntFields) {
    if (key != field.key) continue;
    const auto integer = ToInteger(key, value);
    if (!integer.ok()) return integer.status();
    options.*field.member = *integer;
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(absl::StrCat("unknown key ", Quoted(key)));
}

std::vector<std::string> AllKeys() {
  std::vector<std::string> keys = {kEncoderChannels, kVisibilityHead};
  for (const IntField& field : kIntFields) keys.emplace_back(field.key);
  return keys;
}

}  // namespace

int64_t ModelOptions::ParameterCount() const {
  const int64_t unused_norm = 2 * feature_channels;  // in the published checkpoint, never applied
  return EncoderParameters(*this) + ContextParameters(*this) + UpdateParameters(*this) + unused_norm;
}

absl::Status ModelOptions::Validate() const {
  for (const int64_t channels : encoder_channels) {
    if (auto s = CheckRange(kEncoderChannels, channels, 1, kMaxChannels); !s.ok()) return s;
  }
  for (const IntField& field : kIntFields) {
    if (auto s = CheckRange(field.key, this->*field.member, field.min, field.max); !s.ok()) return s;
  }
  if (feature_channels % 4 != 0) {
    return absl::InvalidArgumentError(
        absl::StrCat("feature_channels is ", feature_channels, "; must be a multiple of 4"));
  }
  if (feature_channels % context_heads != 0) {
    return absl::InvalidArgumentError(
        absl::StrCat("context_heads is ", context_heads, "; must divide feature_channels (", feature_channels, ")"));
  }
  if (ParameterCount() > kMaxParameters) {
    return absl::InvalidArgumentError(
        absl::StrCat("a network of ", ParameterCount(), " parameters; at most ", kMaxParameters));
  }
  return absl::OkStatus();
}

bool operator==(const ModelOptions& a, const ModelOptions& b) {
  for (const IntField& field : kIntFields) {
    if (a.*field.member != b.*field.member) return false;
  }
  return a.encoder_channels == b.encoder_channels && a.visibility_head == b.visibility_head;
}

std::string ModelOptionsToJson(const ModelOptions& options) {
  Json json;
  json[kEncoderChannels] = options.encoder_channels;
  for (const IntField& field : kIntFields) json[field.key] = options.*field.member;
  json[kVisibilityHead] = options.visibility_head;
  return json.dump();
}

absl::StatusOr<ModelOptions> ModelOptionsFromJson(absl::string_view json) {
  const auto object = ParseBoundedJson(json, JsonLimits{4096, 2});
  if (!object.ok()) return object.status();
  if (!object->is_object()) return absl::InvalidArgumentError("model options: expected a JSON object");
  ModelOptions options;
  for (const auto& [key, value] : object->items()) {
    if (auto s = ReadField(key, value, options); !s.ok()) return s;
  }
  for (const std::string& key : AllKeys()) {
    if (!object->contains(key)) return absl::InvalidArgumentError(absl::StrCat("missing key '", key, "'"));
  }
  if (auto s = options.Validate(); !s.ok()) return s;
  return options;
}

}  // namespace holdfast
