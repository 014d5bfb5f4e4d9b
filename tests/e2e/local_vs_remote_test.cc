// SPDX-License-Identifier: Apache-2.0
// The same clip through the engine in this process and through a server must give the same tracks: the wire, the
// server and the client add and lose nothing.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/remote_tracker.h"
#include "server/engine/engine.h"
#include "server/engine/local_tracker.h"
#include "server/logging.h"
#include "server/server.h"
#include "tests/support/source_tree.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

constexpr int kFrames = 40;
constexpr ImageSize kSize{256, 192};
constexpr PointId kRemoved = 3;
constexpr ObjectId kObject = 9;
constexpr int kObjectPoints = 8;
constexpr int64_t kObjectFrame = 2;

class NullServerEvents final : public ServerEvents {
 public:
  void StreamRefused(RefusalReason) override {}
  void SessionResumed(ResumeResult) override {}
  void CheckpointSent(int64_t) override {}
  void SpansDone(SpanResult, int64_t) override {}
};

// Raw frames, so that both sides see equal pixels.
std::vector<std::string> ReadClip() {
  cv::VideoCapture video(InSourceTree("media/pedestrians.mp4"), cv::CAP_FFMPEG);
  std::vector<std::string> frames;
  cv::Mat frame, small;
  while (frames.size() < kFrames && video.read(frame)) {
    cv::resize(frame, small, {kSize.width, kSize.height}, 0, 0, cv::INTER_AREA);
    frames.emplace_back(reinterpret_cast<const char*>(small.data), small.total() * small.elemSize());
  }
  return frames;
}

EngineOptions SmallEngine() {
  EngineOptions options;
  options.weights_path = InSourceTree("weights/small.safetensors");
  options.precision = Precision::kFloat32;
  options.compute_threads = 1;
  options.processing_size = kSize;
  options.iterations = 2;
  return options;
}

struct Estimate {
  float x = 0, y = 0, confidence = 0;
  bool visible = false;
};

class Collector final : public TrackObserver {
 public:
  void OnTracks(TrackUpdate update) override {
    for (const PointRun& run : update.runs) {
      samples_ += static_cast<int64_t>(run.x.size());
      for (int64_t i = 0; i < run.final_count; ++i) {
        final_[{run.id, run.first_frame + i}] = {run.x[i], run.y[i], run.confidence[i], run.visible[i] != 0};
      }
    }
    for (const ObjectRun& run : update.objects) Take(run);
  }
  void OnDone(const absl::Status&, const SessionSummary& summary) override { summary_ = summary; }

  // What is final of kObject.
  void Take(const ObjectRun& run) {
    EXPECT_EQ(run.id, kObject);
    for (int64_t i = 0; i < run.final_count; ++i) objects_[run.first_frame + i] = run.samples[i];
  }

  std::map<std::pair<PointId, int64_t>, Estimate> final_;
  std::map<int64_t, ObjectSample> objects_;
  int64_t samples_ = 0;  // provisional ones too
  SessionSummary summary_;
};

// Points from the start, on a frame, between frames, and one that is removed.
absl::Status TrackClip(PointTracker& tracker, const std::vector<std::string>& clip, Collector& collector,
                       Emit emit = Emit::kWindows) {
  SessionConfig config;
  config.encoding = FrameEncoding::kBgr24;
  config.raw_size = kSize;
  config.emit = emit;
  config.points = {{1, 88, 80}, {2, 170, 62}, {kRemoved, 220, 90}};
  auto stream = tracker.Open(config, collector);
  if (!stream.ok()) return stream.status();
  for (int64_t i = 0; i < kFrames; ++i) {
    Frame frame;
    frame.index = i;
    frame.bytes = clip[i];
    if (i == kObjectFrame) {
      frame.objects = {{kObject, "", {{76, 60}, {100, 60}, {100, 100}, {76, 100}}, kObjectPoints}};
    }
    if (i == 5) frame.points = {{4, 120, 120}};
    absl::Status status = (*stream)->PushFrame(std::move(frame));
    if (status.ok() && i == 10) status = (*stream)->AddPoints({{5, 30, 60}, {6, 140, 100}});
    if (status.ok() && i == 30) status = (*stream)->RemovePoints({kRemoved});
    if (!status.ok()) return status;
  }
  return (*stream)->Finish();
}

int64_t SamplesOf(const Collector& collector, PointId id) {
  return std::count_if(collector.final_.begin(), collector.final_.end(),
                       [id](const auto& entry) { return entry.first.first == id; });
}

void ExpectSameObjects(const Collector& a, const Collector& b) {
  ASSERT_EQ(a.objects_.size(), static_cast<size_t>(kFrames - kObjectFrame));
  ASSERT_EQ(b.objects_.size(), a.objects_.size());
  for (const auto& [frame, here] : a.objects_) {
    const ObjectSample& there = b.objects_.at(frame);
    EXPECT_NEAR(here.centre.x, there.centre.x, 1e-2f) << frame;
    EXPECT_NEAR(here.centre.y, there.centre.y, 1e-2f) << frame;
    EXPECT_EQ(here.visible, there.visible) << frame;
    EXPECT_EQ(here.outline.size(), there.outline.size()) << frame;
    EXPECT_EQ(here.left, there.left) << frame;
  }
}

TEST(LocalVsRemoteTest, BothGiveTheSameTracks) {
  const std::vector<std::string> clip = ReadClip();
  ASSERT_EQ(clip.size(), static_cast<size_t>(kFrames));
  SystemClock clock;
  NullEngineMetrics metrics;
  NullServerEvents events;
  const auto engine = Engine::Create(SmallEngine(), clock, metrics);
  ASSERT_THAT(engine, IsOk());

  LocalTracker local(**engine);
  Collector in_process;
  ASSERT_THAT(TrackClip(local, clip, in_process), IsOk());

  ServerOptions options;
  options.listen = "127.0.0.1:0";
  const auto server = Server::Start(options, clock, events, MakeLogger(LogFormat::kText, "off"));
  ASSERT_THAT(server, IsOk());
  (*server)->Serve(**engine);
  RemoteTracker::Options client;
  client.addresses = {absl::StrCat("127.0.0.1:", (*server)->port())};
  const auto remote = RemoteTracker::Connect(client);
  ASSERT_THAT(remote, IsOk());
  Collector over_the_wire;
  ASSERT_THAT(TrackClip(**remote, clip, over_the_wire), IsOk());

  for (const auto& [id, first] : {std::pair<PointId, int64_t>{1, 0}, {2, 0}, {4, 5}, {5, 10}, {6, 10}}) {
    EXPECT_EQ(SamplesOf(in_process, id), kFrames - first) << "point " << id;
    EXPECT_EQ(SamplesOf(over_the_wire, id), kFrames - first) << "point " << id;
  }
  float largest = 0;
  for (const auto& [key, there] : over_the_wire.final_) {
    const auto found = in_process.final_.find(key);
    // How much of a removed point becomes final depends on how far the engine is when it hears of it.
    if (found == in_process.final_.end() && key.first == kRemoved) continue;
    ASSERT_NE(found, in_process.final_.end());
    const Estimate& here = found->second;
    largest = std::max({largest, std::abs(here.x - there.x), std::abs(here.y - there.y)});
    EXPECT_EQ(here.visible, there.visible);
    EXPECT_NEAR(here.confidence, there.confidence, 1e-4);
  }
  EXPECT_LE(largest, 1e-3f);
  RecordProperty("largest_difference_px", absl::StrCat(largest));
  EXPECT_EQ(over_the_wire.summary_.frames, kFrames);
  EXPECT_GE(over_the_wire.summary_.points, 6 + kObjectPoints);  // and those of the object that were placed anew
  EXPECT_EQ(over_the_wire.summary_.points, in_process.summary_.points);
  ExpectSameObjects(in_process, over_the_wire);

  Collector every_frame;
  ASSERT_THAT(TrackClip(**remote, clip, every_frame, Emit::kEveryFrame), IsOk());
  for (const auto& [key, there] : over_the_wire.final_) {
    if (key.first == kRemoved) continue;
    const auto found = every_frame.final_.find(key);
    ASSERT_NE(found, every_frame.final_.end());
    EXPECT_NEAR(found->second.x, there.x, 1e-3f);
    EXPECT_NEAR(found->second.y, there.y, 1e-3f);
  }
  ExpectSameObjects(every_frame, over_the_wire);
  EXPECT_GT(every_frame.samples_, over_the_wire.samples_) << "instant estimates came besides";

  const auto info = (*remote)->Info();
  ASSERT_THAT(info, IsOk());
  EXPECT_EQ(info->weights_sha256, local.Info()->weights_sha256);
  EXPECT_EQ(info->precision, "float32");
  EXPECT_TRUE(info->default_motion_prior);
  EXPECT_TRUE(info->default_polish);
}

}  // namespace
}  // namespace holdfast
