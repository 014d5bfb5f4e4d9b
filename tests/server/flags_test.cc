// SPDX-License-Identifier: Apache-2.0
#include "server/flags.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "absl/flags/reflection.h"
#include "program/flags.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

using Variables = std::map<std::string, std::string>;

class FlagsTest : public ::testing::Test {
 protected:
  static absl::StatusOr<ServerOptions> OptionsWith(const Variables& variables) {
    const auto getenv = [&](const char* name) -> const char* {
      const auto found = variables.find(name);
      return found == variables.end() ? nullptr : found->second.c_str();
    };
    if (const absl::Status status = SetFlags({}, getenv); !status.ok()) return status;
    return OptionsFromFlags();
  }
  absl::FlagSaver saver_;
};

TEST_F(FlagsTest, DefaultsAreValid) {
  const auto options = OptionsWith({});
  ASSERT_THAT(options, IsOk());
  EXPECT_EQ(options->listen, "[::]:50051");
  EXPECT_EQ(options->metrics_listen, "0.0.0.0:9464");
  EXPECT_EQ(options->engine.processing_size, (ImageSize{512, 384}));
  EXPECT_EQ(options->engine.limits.max_frame_pixels, 3840 * 2160);
  EXPECT_EQ(options->engine.cache_budget_bytes, int64_t{4} << 30);
  EXPECT_TRUE(options->engine.motion_prior);
  EXPECT_TRUE(options->engine.polish);
}

TEST_F(FlagsTest, WhatIsNotGivenIsAsTheOptionsHaveIt) {
  const auto options = OptionsWith({});
  ASSERT_THAT(options, IsOk());
  const ServerOptions defaults;
  EXPECT_EQ(options->engine.limits.max_points, defaults.engine.limits.max_points);
  EXPECT_EQ(options->engine.limits.max_frame_bytes, defaults.engine.limits.max_frame_bytes);
  EXPECT_EQ(options->engine.limits.max_frame_pixels, defaults.engine.limits.max_frame_pixels);
  EXPECT_EQ(options->engine.limits.max_frames, defaults.engine.limits.max_frames);
  EXPECT_EQ(options->engine.cache_budget_bytes, defaults.engine.cache_budget_bytes);
  EXPECT_EQ(options->engine.precision, defaults.engine.precision);
  EXPECT_EQ(options->engine.hop_frames, defaults.engine.hop_frames);
  EXPECT_EQ(options->grace_period, defaults.grace_period);
  EXPECT_EQ(options->checkpoint_keys, defaults.checkpoint_keys);
  EXPECT_EQ(options->checkpoint_max_age, absl::Hours(24));
  EXPECT_EQ(options->log_format, defaults.log_format);
}

TEST_F(FlagsTest, EveryKindOfFlagComesFromTheEnvironmentToo) {
  const auto options = OptionsWith({{"HOLDFAST_LISTEN", "0.0.0.0:1"},
                                    {"HOLDFAST_MAX_SESSIONS", "3"},
                                    {"HOLDFAST_MAX_FRAME_MIB", "2"},
                                    {"HOLDFAST_MAX_FRAME_MEGAPIXELS", "0.5"},
                                    {"HOLDFAST_MAX_SESSION_FRAMES", "1000"},
                                    {"HOLDFAST_CACHE_MIB", "10000"},
                                    {"HOLDFAST_PROCESSING_SIZE", "640x480"},
                                    {"HOLDFAST_PRECISION", "bfloat16"},
                                    {"HOLDFAST_MOTION_PRIOR", "false"},
                                    {"HOLDFAST_POLISH", "false"},
                                    {"HOLDFAST_LEAST_STEP", "1.5"},
                                    {"HOLDFAST_IDLE_TIMEOUT", "90s"},
                                    {"HOLDFAST_MAX_CONNECTION_AGE", "1h"},
                                    {"HOLDFAST_CHECKPOINT_KEYS", "/run/secrets/keys"},
                                    {"HOLDFAST_CHECKPOINT_MAX_AGE", "inf"},
                                    {"HOLDFAST_LOG_FORMAT", "json"}});
  ASSERT_THAT(options, IsOk());
  EXPECT_EQ(options->listen, "0.0.0.0:1");
  EXPECT_FALSE(options->engine.motion_prior);
  EXPECT_FALSE(options->engine.polish);
  EXPECT_EQ(options->engine.least_step, 1.5);
  EXPECT_EQ(options->engine.max_sessions, 3);
  EXPECT_EQ(options->engine.limits.max_frame_bytes, 2 << 20);
  EXPECT_EQ(options->engine.limits.max_frame_pixels, 500'000);
  EXPECT_EQ(options->engine.limits.max_frames, 1000);
  EXPECT_EQ(options->engine.cache_budget_bytes, int64_t{10000} << 20);
  EXPECT_EQ(options->engine.processing_size, (ImageSize{640, 480}));
  EXPECT_EQ(options->engine.precision, Precision::kBFloat16);
  EXPECT_EQ(options->idle_timeout, absl::Seconds(90));
  EXPECT_EQ(options->max_connection_age, absl::Hours(1));
  EXPECT_EQ(options->checkpoint_keys, "/run/secrets/keys");
  EXPECT_EQ(options->checkpoint_max_age, absl::InfiniteDuration());
  EXPECT_EQ(options->log_format, LogFormat::kJson);
}

TEST_F(FlagsTest, VariablesThatNameNoFlagAreLeftAlone) {
  EXPECT_THAT(OptionsWith({{"HOLDFAST_PORT", "tcp://10.0.0.1:50051"}, {"HOLDFAST_SERVICE_HOST", "10.0.0.1"}}), IsOk());
}

TEST_F(FlagsTest, OriginsAreAList) {
  const auto options = OptionsWith({{"HOLDFAST_WEB_ORIGINS", "https://tracks.example,http://box.lan:8080"}});
  ASSERT_THAT(options, IsOk());
  EXPECT_THAT(options->web_origins, ElementsAre("https://tracks.example", "http://box.lan:8080"));
}

TEST_F(FlagsTest, ABadVariableIsNamedWithItsValue) {
  EXPECT_THAT(
      OptionsWith({{"HOLDFAST_MAX_SESSIONS", "many"}}),
      StatusIs(absl::StatusCode::kInvalidArgument, AllOf(HasSubstr("HOLDFAST_MAX_SESSIONS"), HasSubstr("many"))));
}

TEST_F(FlagsTest, ValuesThatCannotBeAreRefusedByName) {
  const std::vector<std::pair<std::string, std::string>> wrong = {
      {"processing_size", "512"},
      {"processing_size", "0x384"},
      {"precision", "float64"},
      {"log_format", "xml"},
      {"log_level", "loud"},
      {"idle_timeout", "0s"},
      {"grace_period", "-1s"},
      {"listen", ""},
      {"listen", "127.0.0.1:70000"},
      {"listen", "nowhere"},
      {"listen", "unix:/run/holdfast.sock"},
      {"listen", "unix:50051"},
      {"keepalive_time", "-inf"},
      {"metrics_listen", ""},
      {"checkpoint_max_age", "0s"},
      {"grace_period", "inf"},
      {"metrics_listen", "9464"},
      {"web_listen", "nonsense"},
      {"web_origins", "https://tracks.example,https://tracks.example/"},
      {"max_sessions", "0"},
      {"max_sessions", "2147483647"},
      {"max_pending_frames", "2147483647"},
      {"cache_mib", "17592186044417"},
      {"cache_mib", "0"},
      {"max_frame_mib", "-5"},
      {"max_frame_megapixels", "nan"},
      {"iterations", "17"},
      {"hop", "0"},
      {"least_fps", "-1"},
      {"max_load", "nan"},
      {"max_points", "0"},
      {"max_session_frames", "-1"},
  };
  for (const auto& [flag, value] : wrong) {
    absl::FlagSaver saver;
    std::string variable = "HOLDFAST_" + flag;
    for (char& c : variable) c = static_cast<char>(toupper(c));
    EXPECT_THAT(OptionsWith({{variable, value}}), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(flag)))
        << value;
  }
}

}  // namespace
}  // namespace holdfast
