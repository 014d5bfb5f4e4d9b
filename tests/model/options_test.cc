// SPDX-License-Identifier: Apache-2.0
#include "model/options.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "model/presets.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::UnorderedElementsAre;

nlohmann::json PaperJson() { return nlohmann::json::parse(ModelOptionsToJson(*PresetByName("paper"))); }

TEST(ModelOptionsTest, CountsTheParametersThatThePaperReports) {
  EXPECT_EQ(PresetByName("paper")->ParameterCount(), 18656226);
  EXPECT_EQ(PresetByName("pips2")->ParameterCount(), 17565410);
}

TEST(ModelOptionsTest, JsonHasExactlyTheThirteenKeys) {
  const nlohmann::json json = PaperJson();
  std::vector<std::string> keys;
  for (const auto& item : json.items()) keys.push_back(item.key());
  EXPECT_THAT(keys,
              UnorderedElementsAre("encoder_channels", "encoder_mid", "feature_channels", "stride", "context_blocks",
                                   "context_heads", "context_mlp_ratio", "context_patch", "correlation_levels",
                                   "correlation_radius", "update_base", "visibility_head", "window"));
}

TEST(ModelOptionsTest, EveryPresetSurvivesTheRoundTripThroughJson) {
  for (const std::string& name : PresetNames()) {
    const ModelOptions options = *PresetByName(name);
    EXPECT_THAT(options.Validate(), IsOk()) << name;
    EXPECT_THAT(ModelOptionsFromJson(ModelOptionsToJson(options)), IsOkAndHolds(options)) << name;
  }
}

TEST(ModelOptionsTest, AMissingKeyIsNamed) {
  const nlohmann::json all = PaperJson();
  for (const auto& item : all.items()) {
    nlohmann::json json = all;
    json.erase(item.key());
    EXPECT_THAT(ModelOptionsFromJson(json.dump()), StatusIs(kInvalid, HasSubstr("missing key '" + item.key() + "'")));
  }
}

TEST(ModelOptionsTest, AWrongTypeIsRefusedForEveryKey) {
  const nlohmann::json all = PaperJson();
  for (const auto& item : all.items()) {
    for (const nlohmann::json& wrong : {nlohmann::json(1.5), nlohmann::json("8"), nlohmann::json(nullptr),
                                        nlohmann::json(18446744073709551615u), nlohmann::json::array({1, 2})}) {
      nlohmann::json json = all;
      json[item.key()] = wrong;
      EXPECT_THAT(ModelOptionsFromJson(json.dump()), StatusIs(kInvalid, HasSubstr(item.key()))) << wrong;
    }
  }
}

TEST(ModelOptionsTest, AValueOutOfItsBoundsIsNamed) {
  for (const auto& [key, value] : std::map<std::string, int64_t>{{"encoder_mid", 4097},
                                                                 {"feature_channels", 4},
                                                                 {"stride", 4},
                                                                 {"context_blocks", -1},
                                                                 {"context_heads", 0},
                                                                 {"context_mlp_ratio", 17},
                                                                 {"context_patch", 0},
                                                                 {"correlation_levels", 7},
                                                                 {"correlation_radius", 9},
                                                                 {"update_base", 0},
                                                                 {"window", 1}}) {
    nlohmann::json json = PaperJson();
    json[key] = value;
    EXPECT_THAT(ModelOptionsFromJson(json.dump()), StatusIs(kInvalid, HasSubstr(key + " is"))) << value;
  }
}

TEST(ModelOptionsTest, FeatureChannelsMustSuitTheEmbeddingAndTheHeads) {
  ModelOptions options;
  options.feature_channels = 126;
  EXPECT_THAT(options.Validate(), StatusIs(kInvalid, HasSubstr("multiple of 4")));
  options.feature_channels = 128;
  options.context_heads = 12;
  EXPECT_THAT(options.Validate(), StatusIs(kInvalid, HasSubstr("divide feature_channels")));
}

TEST(ModelOptionsTest, AGiantNetworkIsRefusedThoughEachFieldIsInItsBounds) {
  ModelOptions options;
  options.update_base = 4096;
  EXPECT_THAT(options.Validate(), StatusIs(kInvalid, HasSubstr("parameters; at most")));
}

TEST(ModelOptionsTest, OtherKeysRepeatedKeysAndOtherTextsAreRefused) {
  nlohmann::json json = PaperJson();
  json["colour"] = 1;
  EXPECT_THAT(ModelOptionsFromJson(json.dump()), StatusIs(kInvalid, HasSubstr("unknown key 'colour'")));
  EXPECT_THAT(ModelOptionsFromJson("{\"\\u001b[2J\": 1}"), StatusIs(kInvalid, HasSubstr("unknown key '\\x1b[2J'")));
  const std::string repeated = "{\"window\": 24," + PaperJson().dump().substr(1);
  EXPECT_THAT(ModelOptionsFromJson(repeated), StatusIs(kInvalid, HasSubstr("'window' stands twice")));
  EXPECT_THAT(ModelOptionsFromJson("[]"), StatusIs(kInvalid, HasSubstr("JSON object")));
  EXPECT_THAT(ModelOptionsFromJson("{\"window\": "), StatusIs(kInvalid, HasSubstr("syntax")));
  EXPECT_THAT(ModelOptionsFromJson("{\"window\": [[[1]]]}"), StatusIs(kInvalid, HasSubstr("nested deeper")));
  EXPECT_THAT(ModelOptionsFromJson(std::string(5000, ' ')), StatusIs(kInvalid, HasSubstr("5000 bytes")));
}

TEST(PresetsTest, NamesAreThoseOfTheDesign) {
  EXPECT_THAT(PresetNames(), ElementsAre("paper", "pips2", "small", "test"));
}

TEST(PresetsTest, AnUnknownNameIsAnsweredWithTheNamesThereAre) {
  EXPECT_THAT(PresetByName("large"), StatusIs(absl::StatusCode::kNotFound, HasSubstr("paper, pips2, small, test")));
}

TEST(PresetsTest, OptionsFindTheNameOfTheirPreset) {
  for (const std::string& name : PresetNames()) EXPECT_EQ(PresetName(*PresetByName(name)), name);
  ModelOptions options;
  options.window = 12;
  EXPECT_EQ(PresetName(options), "custom");
}

}  // namespace
}  // namespace holdfast
