// SPDX-License-Identifier: Apache-2.0
// Tokens of checkpoints. A first byte of 0: the rest is a token. Otherwise the rest is what a token holds, sealed with
// the right key, as after a leak; what is taken goes on in an engine, whose network is known, for a few frames, and
// ends as the first byte says.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/null_sink.h>

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <utility>
#include <vector>

#include "server/checkpoint/state_convert.h"
#include "server/checkpoint/token.h"
#include "server/checkpoint/token_sealer.h"
#include "server/engine/engine_with_model.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/server/checkpoint/random_state.h"
#include "tests/support/fake_tracker_model.h"
#include "tests/support/memory_file.h"
#include "tests/support/recorders.h"
#include "tests/support/simulated_clock.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

const char kKeys[] = "one:abababababababababababababababababababababababababababababababab\n";
constexpr int64_t kMaxPixels = int64_t{64} * 64;

EngineOptions Options(const CheckpointSealer& sealer) {
  EngineOptions options;
  options.decode_threads = 1;
  options.processing_size = {32, 32};
  options.max_processing_pixels = kMaxPixels;
  options.hop_frames = 2;
  options.iterations = 1;
  options.max_sessions = 1;
  options.limits = {/*max_points=*/16, /*max_frame_bytes=*/1 << 16, kMaxPixels, 0};
  options.sealer = &sealer;
  return options;
}

// A frame of one colour.
std::string Picture(FrameEncoding encoding, ImageSize size) {
  if (IsRaw(encoding)) {
    return std::string(static_cast<size_t>(Pixels(size)) * (encoding == FrameEncoding::kGray8 ? 1 : 3), '\x77');
  }
  std::vector<uint8_t> bytes;
  cv::imencode(encoding == FrameEncoding::kPng ? ".png" : ".jpg", cv::Mat(size.height, size.width, CV_8UC1, 77.0),
               bytes);
  return {bytes.begin(), bytes.end()};
}

void Resume(const SessionState& state, const std::string& token, const TokenSealer& sealer, bool finish) {
  SimulatedClock clock;
  NullEngineMetrics metrics;
  const auto engine =
      CreateEngineWithModel(Options(sealer), std::make_unique<FakeTrackerModel>(/*window_frames=*/6), clock, metrics);
  ASSERT_THAT(engine, IsOk());
  SessionConfig config;
  config.encoding = state.encoding;
  if (IsRaw(state.encoding)) config.raw_size = state.frame_size;
  config.resume_token = token;
  config.checkpoint_interval_frames = 3;
  RecordingListener listener;
  const auto session = (*engine)->OpenSession(config, listener);
  if (!session.ok()) return;
  if (Pixels(state.frame_size) <= kMaxPixels) {
    const std::string picture = Picture(state.encoding, state.frame_size);
    for (int64_t i = 0; i < 16; ++i) {
      if (!listener.Push(**session, {state.next_frame + i, picture, {}, {}}).ok()) break;
      if (state.next_frame + i == state.taken_frame + 1) (void)(*session)->AddPoints({{7, 0, 0}, {8, 0, 0}, {9, 0, 0}});
    }
  }
  if (finish) {
    (*session)->Finish();
  } else {
    (*session)->Suspend(absl::UnavailableError("the server is shutting down"));
  }
  (void)listener.AwaitDone();
}

// With the checksum of the known network, which a mutation would hardly leave alone.
std::string OfThisNetwork(absl::string_view content) {
  checkpoint::v1::SessionState message;
  if (!message.ParseFromArray(content.data(), static_cast<int>(content.size()))) return std::string(content);
  message.clear_weights_sha256();
  return message.SerializeAsString();
}

void RunToken(FuzzInput& input) {
  const MemoryFile keys(kKeys);
  const SimulatedClock clock;
  const auto log = std::make_shared<spdlog::logger>("", std::make_shared<spdlog::sinks::null_sink_mt>());
  const auto sealer = TokenSealer::Create({keys.path(), absl::Hours(24)}, clock, log);
  ASSERT_THAT(sealer, IsOk());
  const uint8_t first = input.TakeByte();
  const absl::string_view rest = input.TakeRest();
  if (first == 0) {
    (void)(*sealer)->Unseal(rest);
    return;
  }
  const std::string token = *SealToken(OfThisNetwork(rest), KeyRing::Parse(kKeys)->sealing(), clock.WallNow());
  const absl::StatusOr<SessionState> state = (*sealer)->Unseal(token);
  if (!state.ok()) return;
  const absl::StatusOr<SessionState> again = FromProto(ToProto(*state));
  ASSERT_THAT(again, IsOk());
  EXPECT_EQ(StateBits::Of(*again), StateBits::Of(*state));
  Resume(*state, token, **sealer, first % 2 != 0);
}

}  // namespace
}  // namespace holdfast

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  holdfast::FuzzInput input(data, size);
  holdfast::RunToken(input);
  return 0;
}
